from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class FigureKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FIGURE_KIND_UNSPECIFIED: _ClassVar[FigureKind]
    FIGURE_KIND_GAUGE: _ClassVar[FigureKind]
    FIGURE_KIND_COUNTER: _ClassVar[FigureKind]
FIGURE_KIND_UNSPECIFIED: FigureKind
FIGURE_KIND_GAUGE: FigureKind
FIGURE_KIND_COUNTER: FigureKind

class HealthRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class FigureFamily(_message.Message):
    __slots__ = ("name", "kind", "what", "labels", "values")
    NAME_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    WHAT_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    name: str
    kind: FigureKind
    what: str
    labels: _containers.RepeatedScalarFieldContainer[str]
    values: _containers.RepeatedCompositeFieldContainer[FigureValue]
    def __init__(self, name: _Optional[str] = ..., kind: _Optional[_Union[FigureKind, str]] = ..., what: _Optional[str] = ..., labels: _Optional[_Iterable[str]] = ..., values: _Optional[_Iterable[_Union[FigureValue, _Mapping]]] = ...) -> None: ...

class FigureValue(_message.Message):
    __slots__ = ("labels", "value")
    LABELS_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    labels: _containers.RepeatedScalarFieldContainer[str]
    value: float
    def __init__(self, labels: _Optional[_Iterable[str]] = ..., value: _Optional[float] = ...) -> None: ...

class Health(_message.Message):
    __slots__ = ("service", "instance", "up_seconds", "figures")
    SERVICE_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_FIELD_NUMBER: _ClassVar[int]
    UP_SECONDS_FIELD_NUMBER: _ClassVar[int]
    FIGURES_FIELD_NUMBER: _ClassVar[int]
    service: str
    instance: str
    up_seconds: float
    figures: _containers.RepeatedCompositeFieldContainer[FigureFamily]
    def __init__(self, service: _Optional[str] = ..., instance: _Optional[str] = ..., up_seconds: _Optional[float] = ..., figures: _Optional[_Iterable[_Union[FigureFamily, _Mapping]]] = ...) -> None: ...
