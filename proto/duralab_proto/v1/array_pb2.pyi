from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ElementType(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ELEMENT_TYPE_UNSPECIFIED: _ClassVar[ElementType]
    ELEMENT_TYPE_FLOAT64: _ClassVar[ElementType]
    ELEMENT_TYPE_FLOAT32: _ClassVar[ElementType]
    ELEMENT_TYPE_COMPLEX128: _ClassVar[ElementType]
    ELEMENT_TYPE_INT64: _ClassVar[ElementType]

class ChannelKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CHANNEL_KIND_UNSPECIFIED: _ClassVar[ChannelKind]
    CHANNEL_KIND_DISPLACEMENT: _ClassVar[ChannelKind]
    CHANNEL_KIND_FORCE: _ClassVar[ChannelKind]
    CHANNEL_KIND_MOMENT: _ClassVar[ChannelKind]
    CHANNEL_KIND_ACCELERATION: _ClassVar[ChannelKind]
    CHANNEL_KIND_PRESSURE: _ClassVar[ChannelKind]
    CHANNEL_KIND_RATIO: _ClassVar[ChannelKind]
    CHANNEL_KIND_VELOCITY: _ClassVar[ChannelKind]
    CHANNEL_KIND_STRAIN: _ClassVar[ChannelKind]
    CHANNEL_KIND_ANGLE: _ClassVar[ChannelKind]
    CHANNEL_KIND_VOLTAGE: _ClassVar[ChannelKind]
    CHANNEL_KIND_CURRENT: _ClassVar[ChannelKind]

class Polarity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POLARITY_UNSPECIFIED: _ClassVar[Polarity]
    POLARITY_POSITIVE: _ClassVar[Polarity]
    POLARITY_NEGATIVE: _ClassVar[Polarity]
ELEMENT_TYPE_UNSPECIFIED: ElementType
ELEMENT_TYPE_FLOAT64: ElementType
ELEMENT_TYPE_FLOAT32: ElementType
ELEMENT_TYPE_COMPLEX128: ElementType
ELEMENT_TYPE_INT64: ElementType
CHANNEL_KIND_UNSPECIFIED: ChannelKind
CHANNEL_KIND_DISPLACEMENT: ChannelKind
CHANNEL_KIND_FORCE: ChannelKind
CHANNEL_KIND_MOMENT: ChannelKind
CHANNEL_KIND_ACCELERATION: ChannelKind
CHANNEL_KIND_PRESSURE: ChannelKind
CHANNEL_KIND_RATIO: ChannelKind
CHANNEL_KIND_VELOCITY: ChannelKind
CHANNEL_KIND_STRAIN: ChannelKind
CHANNEL_KIND_ANGLE: ChannelKind
CHANNEL_KIND_VOLTAGE: ChannelKind
CHANNEL_KIND_CURRENT: ChannelKind
POLARITY_UNSPECIFIED: Polarity
POLARITY_POSITIVE: Polarity
POLARITY_NEGATIVE: Polarity

class Array(_message.Message):
    __slots__ = ("element_type", "shape", "data")
    ELEMENT_TYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    element_type: ElementType
    shape: _containers.RepeatedScalarFieldContainer[int]
    data: bytes
    def __init__(self, element_type: _Optional[_Union[ElementType, str]] = ..., shape: _Optional[_Iterable[int]] = ..., data: _Optional[bytes] = ...) -> None: ...

class Sensor(_message.Message):
    __slots__ = ("serial_number", "sensitivity", "sensitivity_unit", "calibration_date", "calibration_due", "minimum", "maximum", "polarity", "warning_level", "abort_level", "drive")
    SERIAL_NUMBER_FIELD_NUMBER: _ClassVar[int]
    SENSITIVITY_FIELD_NUMBER: _ClassVar[int]
    SENSITIVITY_UNIT_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_DATE_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_DUE_FIELD_NUMBER: _ClassVar[int]
    MINIMUM_FIELD_NUMBER: _ClassVar[int]
    MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    POLARITY_FIELD_NUMBER: _ClassVar[int]
    WARNING_LEVEL_FIELD_NUMBER: _ClassVar[int]
    ABORT_LEVEL_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    serial_number: str
    sensitivity: float
    sensitivity_unit: str
    calibration_date: str
    calibration_due: str
    minimum: float
    maximum: float
    polarity: Polarity
    warning_level: float
    abort_level: float
    drive: str
    def __init__(self, serial_number: _Optional[str] = ..., sensitivity: _Optional[float] = ..., sensitivity_unit: _Optional[str] = ..., calibration_date: _Optional[str] = ..., calibration_due: _Optional[str] = ..., minimum: _Optional[float] = ..., maximum: _Optional[float] = ..., polarity: _Optional[_Union[Polarity, str]] = ..., warning_level: _Optional[float] = ..., abort_level: _Optional[float] = ..., drive: _Optional[str] = ...) -> None: ...

class CalculatedTerm(_message.Message):
    __slots__ = ("channel", "weight")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    WEIGHT_FIELD_NUMBER: _ClassVar[int]
    channel: str
    weight: float
    def __init__(self, channel: _Optional[str] = ..., weight: _Optional[float] = ...) -> None: ...

class Channel(_message.Message):
    __slots__ = ("name", "unit", "kind", "minimum", "maximum", "slew_limit", "label", "watchdog", "sensor", "calculated", "holds_static", "ac_coupled", "actuator_speed")
    NAME_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    MINIMUM_FIELD_NUMBER: _ClassVar[int]
    MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    SLEW_LIMIT_FIELD_NUMBER: _ClassVar[int]
    LABEL_FIELD_NUMBER: _ClassVar[int]
    WATCHDOG_FIELD_NUMBER: _ClassVar[int]
    SENSOR_FIELD_NUMBER: _ClassVar[int]
    CALCULATED_FIELD_NUMBER: _ClassVar[int]
    HOLDS_STATIC_FIELD_NUMBER: _ClassVar[int]
    AC_COUPLED_FIELD_NUMBER: _ClassVar[int]
    ACTUATOR_SPEED_FIELD_NUMBER: _ClassVar[int]
    name: str
    unit: str
    kind: ChannelKind
    minimum: float
    maximum: float
    slew_limit: float
    label: str
    watchdog: float
    sensor: Sensor
    calculated: _containers.RepeatedCompositeFieldContainer[CalculatedTerm]
    holds_static: bool
    ac_coupled: bool
    actuator_speed: float
    def __init__(self, name: _Optional[str] = ..., unit: _Optional[str] = ..., kind: _Optional[_Union[ChannelKind, str]] = ..., minimum: _Optional[float] = ..., maximum: _Optional[float] = ..., slew_limit: _Optional[float] = ..., label: _Optional[str] = ..., watchdog: _Optional[float] = ..., sensor: _Optional[_Union[Sensor, _Mapping]] = ..., calculated: _Optional[_Iterable[_Union[CalculatedTerm, _Mapping]]] = ..., holds_static: _Optional[bool] = ..., ac_coupled: _Optional[bool] = ..., actuator_speed: _Optional[float] = ...) -> None: ...

class Record(_message.Message):
    __slots__ = ("channels", "sample_rate", "samples")
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    channels: _containers.RepeatedCompositeFieldContainer[Channel]
    sample_rate: float
    samples: Array
    def __init__(self, channels: _Optional[_Iterable[_Union[Channel, _Mapping]]] = ..., sample_rate: _Optional[float] = ..., samples: _Optional[_Union[Array, _Mapping]] = ...) -> None: ...
