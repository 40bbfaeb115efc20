from duralab_proto.v1 import array_pb2 as _array_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ExcitationKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    EXCITATION_KIND_UNSPECIFIED: _ClassVar[ExcitationKind]
    EXCITATION_KIND_PURE_RANDOM: _ClassVar[ExcitationKind]

class EstimatorKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ESTIMATOR_KIND_UNSPECIFIED: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_H1: _ClassVar[EstimatorKind]
EXCITATION_KIND_UNSPECIFIED: ExcitationKind
EXCITATION_KIND_PURE_RANDOM: ExcitationKind
ESTIMATOR_KIND_UNSPECIFIED: EstimatorKind
ESTIMATOR_KIND_H1: EstimatorKind

class WhitePinkSpectrum(_message.Message):
    __slots__ = ("lowest_frequency", "highest_frequency", "corner_frequency", "decibels_per_octave")
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    CORNER_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    DECIBELS_PER_OCTAVE_FIELD_NUMBER: _ClassVar[int]
    lowest_frequency: float
    highest_frequency: float
    corner_frequency: float
    decibels_per_octave: float
    def __init__(self, lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., corner_frequency: _Optional[float] = ..., decibels_per_octave: _Optional[float] = ...) -> None: ...

class Excitation(_message.Message):
    __slots__ = ("kind", "spectrum", "rms", "duration_seconds", "fade_seconds", "seed")
    KIND_FIELD_NUMBER: _ClassVar[int]
    SPECTRUM_FIELD_NUMBER: _ClassVar[int]
    RMS_FIELD_NUMBER: _ClassVar[int]
    DURATION_SECONDS_FIELD_NUMBER: _ClassVar[int]
    FADE_SECONDS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    kind: ExcitationKind
    spectrum: WhitePinkSpectrum
    rms: _array_pb2.Array
    duration_seconds: float
    fade_seconds: float
    seed: int
    def __init__(self, kind: _Optional[_Union[ExcitationKind, str]] = ..., spectrum: _Optional[_Union[WhitePinkSpectrum, _Mapping]] = ..., rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., duration_seconds: _Optional[float] = ..., fade_seconds: _Optional[float] = ..., seed: _Optional[int] = ...) -> None: ...

class Estimator(_message.Message):
    __slots__ = ("kind", "block_samples", "overlap")
    KIND_FIELD_NUMBER: _ClassVar[int]
    BLOCK_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    OVERLAP_FIELD_NUMBER: _ClassVar[int]
    kind: EstimatorKind
    block_samples: int
    overlap: float
    def __init__(self, kind: _Optional[_Union[EstimatorKind, str]] = ..., block_samples: _Optional[int] = ..., overlap: _Optional[float] = ...) -> None: ...

class IdentifyRequest(_message.Message):
    __slots__ = ("rig", "excitation", "estimator", "run", "rig_seed", "check_only")
    RIG_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    RIG_SEED_FIELD_NUMBER: _ClassVar[int]
    CHECK_ONLY_FIELD_NUMBER: _ClassVar[int]
    rig: str
    excitation: Excitation
    estimator: Estimator
    run: str
    rig_seed: int
    check_only: bool
    def __init__(self, rig: _Optional[str] = ..., excitation: _Optional[_Union[Excitation, _Mapping]] = ..., estimator: _Optional[_Union[Estimator, _Mapping]] = ..., run: _Optional[str] = ..., rig_seed: _Optional[int] = ..., check_only: _Optional[bool] = ...) -> None: ...

class ModelRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Model(_message.Message):
    __slots__ = ("id", "rig", "drives", "responses", "sample_rate", "frequency", "frf", "coherence", "condition_number", "drive_psd", "response_psd", "excitation", "estimator", "blocks", "independent_averages", "rig_content_hash", "run", "signal_epoch", "signal_blocks", "frf_variance")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    FRF_FIELD_NUMBER: _ClassVar[int]
    COHERENCE_FIELD_NUMBER: _ClassVar[int]
    CONDITION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    DRIVE_PSD_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_PSD_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    INDEPENDENT_AVERAGES_FIELD_NUMBER: _ClassVar[int]
    RIG_CONTENT_HASH_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    FRF_VARIANCE_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    drives: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    responses: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    sample_rate: float
    frequency: _array_pb2.Array
    frf: _array_pb2.Array
    coherence: _array_pb2.Array
    condition_number: _array_pb2.Array
    drive_psd: _array_pb2.Array
    response_psd: _array_pb2.Array
    excitation: Excitation
    estimator: Estimator
    blocks: int
    independent_averages: float
    rig_content_hash: str
    run: str
    signal_epoch: int
    signal_blocks: int
    frf_variance: _array_pb2.Array
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., drives: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., responses: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., sample_rate: _Optional[float] = ..., frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., frf: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., coherence: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., condition_number: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., drive_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., excitation: _Optional[_Union[Excitation, _Mapping]] = ..., estimator: _Optional[_Union[Estimator, _Mapping]] = ..., blocks: _Optional[int] = ..., independent_averages: _Optional[float] = ..., rig_content_hash: _Optional[str] = ..., run: _Optional[str] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ..., frf_variance: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...
