from duralab_proto.v1 import array_pb2 as _array_pb2
from duralab_proto.v1 import identifier_pb2 as _identifier_pb2
from duralab_proto.v1 import query_pb2 as _query_pb2
from duralab_proto.v1 import rig_pb2 as _rig_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class UpdateKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    UPDATE_KIND_UNSPECIFIED: _ClassVar[UpdateKind]
    UPDATE_KIND_BASIC_TWR: _ClassVar[UpdateKind]
    UPDATE_KIND_ADAPTIVE_MODELLING: _ClassVar[UpdateKind]

class CampaignPhase(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CAMPAIGN_PHASE_UNSPECIFIED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_CHECKING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_IDENTIFYING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_ITERATING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_FINISHED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_FAULTED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_STOPPED: _ClassVar[CampaignPhase]

class Outcome(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    OUTCOME_UNSPECIFIED: _ClassVar[Outcome]
    OUTCOME_REACHED: _ClassVar[Outcome]
    OUTCOME_ITERATIONS_USED: _ClassVar[Outcome]
    OUTCOME_DIVERGED: _ClassVar[Outcome]
UPDATE_KIND_UNSPECIFIED: UpdateKind
UPDATE_KIND_BASIC_TWR: UpdateKind
UPDATE_KIND_ADAPTIVE_MODELLING: UpdateKind
CAMPAIGN_PHASE_UNSPECIFIED: CampaignPhase
CAMPAIGN_PHASE_CHECKING: CampaignPhase
CAMPAIGN_PHASE_IDENTIFYING: CampaignPhase
CAMPAIGN_PHASE_ITERATING: CampaignPhase
CAMPAIGN_PHASE_FINISHED: CampaignPhase
CAMPAIGN_PHASE_FAULTED: CampaignPhase
CAMPAIGN_PHASE_STOPPED: CampaignPhase
OUTCOME_UNSPECIFIED: Outcome
OUTCOME_REACHED: Outcome
OUTCOME_ITERATIONS_USED: Outcome
OUTCOME_DIVERGED: Outcome

class UpdateSettings(_message.Message):
    __slots__ = ("kind", "iteration_gain", "smallest_correction", "largest_correction", "weigh_by_coherence", "lowest_coherence")
    KIND_FIELD_NUMBER: _ClassVar[int]
    ITERATION_GAIN_FIELD_NUMBER: _ClassVar[int]
    SMALLEST_CORRECTION_FIELD_NUMBER: _ClassVar[int]
    LARGEST_CORRECTION_FIELD_NUMBER: _ClassVar[int]
    WEIGH_BY_COHERENCE_FIELD_NUMBER: _ClassVar[int]
    LOWEST_COHERENCE_FIELD_NUMBER: _ClassVar[int]
    kind: UpdateKind
    iteration_gain: _array_pb2.Array
    smallest_correction: float
    largest_correction: float
    weigh_by_coherence: bool
    lowest_coherence: float
    def __init__(self, kind: _Optional[_Union[UpdateKind, str]] = ..., iteration_gain: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., smallest_correction: _Optional[float] = ..., largest_correction: _Optional[float] = ..., weigh_by_coherence: _Optional[bool] = ..., lowest_coherence: _Optional[float] = ...) -> None: ...

class StopCriteria(_message.Message):
    __slots__ = ("largest_iterations", "relative_rms_error", "divergence_ratio")
    LARGEST_ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    DIVERGENCE_RATIO_FIELD_NUMBER: _ClassVar[int]
    largest_iterations: int
    relative_rms_error: float
    divergence_ratio: float
    def __init__(self, largest_iterations: _Optional[int] = ..., relative_rms_error: _Optional[float] = ..., divergence_ratio: _Optional[float] = ...) -> None: ...

class CampaignSpec(_message.Message):
    __slots__ = ("id", "rig", "target", "target_source", "excitation", "estimator", "update", "stop", "lowest_frequency", "highest_frequency", "seed", "scenario", "target_drive", "target_rig", "target_seed")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    TARGET_SOURCE_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    UPDATE_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    TARGET_DRIVE_FIELD_NUMBER: _ClassVar[int]
    TARGET_RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_SEED_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    target: _array_pb2.Record
    target_source: str
    excitation: _identifier_pb2.Excitation
    estimator: _identifier_pb2.Estimator
    update: UpdateSettings
    stop: StopCriteria
    lowest_frequency: float
    highest_frequency: float
    seed: int
    scenario: str
    target_drive: _array_pb2.Record
    target_rig: str
    target_seed: int
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., target: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., target_source: _Optional[str] = ..., excitation: _Optional[_Union[_identifier_pb2.Excitation, _Mapping]] = ..., estimator: _Optional[_Union[_identifier_pb2.Estimator, _Mapping]] = ..., update: _Optional[_Union[UpdateSettings, _Mapping]] = ..., stop: _Optional[_Union[StopCriteria, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., seed: _Optional[int] = ..., scenario: _Optional[str] = ..., target_drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., target_rig: _Optional[str] = ..., target_seed: _Optional[int] = ...) -> None: ...

class CampaignRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class StopCampaignRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class ResumeCampaignRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class CampaignStatus(_message.Message):
    __slots__ = ("id", "phase", "activity", "fraction", "remaining_seconds", "iterations", "outcome", "fault", "best_iteration")
    ID_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    ACTIVITY_FIELD_NUMBER: _ClassVar[int]
    FRACTION_FIELD_NUMBER: _ClassVar[int]
    REMAINING_SECONDS_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    BEST_ITERATION_FIELD_NUMBER: _ClassVar[int]
    id: str
    phase: CampaignPhase
    activity: str
    fraction: float
    remaining_seconds: float
    iterations: _containers.RepeatedCompositeFieldContainer[IterationMetrics]
    outcome: Outcome
    fault: _query_pb2.Fault
    best_iteration: int
    def __init__(self, id: _Optional[str] = ..., phase: _Optional[_Union[CampaignPhase, str]] = ..., activity: _Optional[str] = ..., fraction: _Optional[float] = ..., remaining_seconds: _Optional[float] = ..., iterations: _Optional[_Iterable[_Union[IterationMetrics, _Mapping]]] = ..., outcome: _Optional[_Union[Outcome, str]] = ..., fault: _Optional[_Union[_query_pb2.Fault, _Mapping]] = ..., best_iteration: _Optional[int] = ...) -> None: ...

class ChannelMetrics(_message.Message):
    __slots__ = ("channel", "relative_rms_error", "rms_response", "peak_ratio")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    RMS_RESPONSE_FIELD_NUMBER: _ClassVar[int]
    PEAK_RATIO_FIELD_NUMBER: _ClassVar[int]
    channel: str
    relative_rms_error: float
    rms_response: float
    peak_ratio: float
    def __init__(self, channel: _Optional[str] = ..., relative_rms_error: _Optional[float] = ..., rms_response: _Optional[float] = ..., peak_ratio: _Optional[float] = ...) -> None: ...

class IterationMetrics(_message.Message):
    __slots__ = ("iteration", "channels", "overall_relative_rms_error")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    OVERALL_RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    channels: _containers.RepeatedCompositeFieldContainer[ChannelMetrics]
    overall_relative_rms_error: float
    def __init__(self, iteration: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[ChannelMetrics, _Mapping]]] = ..., overall_relative_rms_error: _Optional[float] = ...) -> None: ...

class CampaignEvent(_message.Message):
    __slots__ = ("status",)
    STATUS_FIELD_NUMBER: _ClassVar[int]
    status: CampaignStatus
    def __init__(self, status: _Optional[_Union[CampaignStatus, _Mapping]] = ...) -> None: ...

class IterationStep(_message.Message):
    __slots__ = ("iteration", "run", "drive", "response", "metrics", "actuators", "inverse_frf", "response_in_band")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    ACTUATORS_FIELD_NUMBER: _ClassVar[int]
    INVERSE_FRF_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_IN_BAND_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    run: str
    drive: _array_pb2.Record
    response: _array_pb2.Record
    metrics: IterationMetrics
    actuators: _containers.RepeatedCompositeFieldContainer[_rig_pb2.ActuatorUse]
    inverse_frf: _array_pb2.Array
    response_in_band: _array_pb2.Array
    def __init__(self, iteration: _Optional[int] = ..., run: _Optional[str] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., metrics: _Optional[_Union[IterationMetrics, _Mapping]] = ..., actuators: _Optional[_Iterable[_Union[_rig_pb2.ActuatorUse, _Mapping]]] = ..., inverse_frf: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response_in_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class TargetInBand(_message.Message):
    __slots__ = ("samples",)
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    samples: _array_pb2.Array
    def __init__(self, samples: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...
