from duralab_proto.v1 import array_pb2 as _array_pb2
from duralab_proto.v1 import query_pb2 as _query_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class AlarmLevel(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALARM_LEVEL_UNSPECIFIED: _ClassVar[AlarmLevel]
    ALARM_LEVEL_WARNING: _ClassVar[AlarmLevel]
    ALARM_LEVEL_ABORT: _ClassVar[AlarmLevel]

class AlarmKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALARM_KIND_UNSPECIFIED: _ClassVar[AlarmKind]
    ALARM_KIND_LIMIT: _ClassVar[AlarmKind]
    ALARM_KIND_SUDDEN_CHANGE: _ClassVar[AlarmKind]
    ALARM_KIND_SLOW_DRIFT: _ClassVar[AlarmKind]

class AlarmAction(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALARM_ACTION_UNSPECIFIED: _ClassVar[AlarmAction]
    ALARM_ACTION_LOG: _ClassVar[AlarmAction]
    ALARM_ACTION_HOLD: _ClassVar[AlarmAction]
    ALARM_ACTION_STOP: _ClassVar[AlarmAction]
    ALARM_ACTION_ITERATE_AGAIN: _ClassVar[AlarmAction]

class RepeatEnd(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REPEAT_END_UNSPECIFIED: _ClassVar[RepeatEnd]
    REPEAT_END_PLAYED: _ClassVar[RepeatEnd]
    REPEAT_END_UNKNOWN: _ClassVar[RepeatEnd]

class EnduranceDecisionKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ENDURANCE_DECISION_KIND_UNSPECIFIED: _ClassVar[EnduranceDecisionKind]
    ENDURANCE_DECISION_KIND_CONTINUE: _ClassVar[EnduranceDecisionKind]
    ENDURANCE_DECISION_KIND_ITERATE_AGAIN: _ClassVar[EnduranceDecisionKind]
    ENDURANCE_DECISION_KIND_END: _ClassVar[EnduranceDecisionKind]
    ENDURANCE_DECISION_KIND_RELEARN: _ClassVar[EnduranceDecisionKind]

class EndurancePhase(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ENDURANCE_PHASE_UNSPECIFIED: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_CHECKING: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_PLAYING: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_HOLDING: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_ITERATING: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_FINISHED: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_STOPPED: _ClassVar[EndurancePhase]
    ENDURANCE_PHASE_FAULTED: _ClassVar[EndurancePhase]
ALARM_LEVEL_UNSPECIFIED: AlarmLevel
ALARM_LEVEL_WARNING: AlarmLevel
ALARM_LEVEL_ABORT: AlarmLevel
ALARM_KIND_UNSPECIFIED: AlarmKind
ALARM_KIND_LIMIT: AlarmKind
ALARM_KIND_SUDDEN_CHANGE: AlarmKind
ALARM_KIND_SLOW_DRIFT: AlarmKind
ALARM_ACTION_UNSPECIFIED: AlarmAction
ALARM_ACTION_LOG: AlarmAction
ALARM_ACTION_HOLD: AlarmAction
ALARM_ACTION_STOP: AlarmAction
ALARM_ACTION_ITERATE_AGAIN: AlarmAction
REPEAT_END_UNSPECIFIED: RepeatEnd
REPEAT_END_PLAYED: RepeatEnd
REPEAT_END_UNKNOWN: RepeatEnd
ENDURANCE_DECISION_KIND_UNSPECIFIED: EnduranceDecisionKind
ENDURANCE_DECISION_KIND_CONTINUE: EnduranceDecisionKind
ENDURANCE_DECISION_KIND_ITERATE_AGAIN: EnduranceDecisionKind
ENDURANCE_DECISION_KIND_END: EnduranceDecisionKind
ENDURANCE_DECISION_KIND_RELEARN: EnduranceDecisionKind
ENDURANCE_PHASE_UNSPECIFIED: EndurancePhase
ENDURANCE_PHASE_CHECKING: EndurancePhase
ENDURANCE_PHASE_PLAYING: EndurancePhase
ENDURANCE_PHASE_HOLDING: EndurancePhase
ENDURANCE_PHASE_ITERATING: EndurancePhase
ENDURANCE_PHASE_FINISHED: EndurancePhase
ENDURANCE_PHASE_STOPPED: EndurancePhase
ENDURANCE_PHASE_FAULTED: EndurancePhase

class ScheduledEvent(_message.Message):
    __slots__ = ("name", "drive", "source", "planned_damage", "campaign")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    PLANNED_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    CAMPAIGN_FIELD_NUMBER: _ClassVar[int]
    name: str
    drive: _array_pb2.Record
    source: str
    planned_damage: _array_pb2.Array
    campaign: str
    def __init__(self, name: _Optional[str] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., source: _Optional[str] = ..., planned_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., campaign: _Optional[str] = ...) -> None: ...

class EnduranceSpec(_message.Message):
    __slots__ = ("id", "rig", "schedule", "events", "seed", "real_time")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    SCHEDULE_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    schedule: str
    events: _containers.RepeatedCompositeFieldContainer[ScheduledEvent]
    seed: int
    real_time: bool
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., schedule: _Optional[str] = ..., events: _Optional[_Iterable[_Union[ScheduledEvent, _Mapping]]] = ..., seed: _Optional[int] = ..., real_time: _Optional[bool] = ...) -> None: ...

class EnduranceAlarm(_message.Message):
    __slots__ = ("repeat", "event", "level", "kind", "channel", "lowest_frequency", "highest_frequency", "since_repeat", "sentence", "action", "measure", "size", "found")
    REPEAT_FIELD_NUMBER: _ClassVar[int]
    EVENT_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SINCE_REPEAT_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    MEASURE_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    FOUND_FIELD_NUMBER: _ClassVar[int]
    repeat: int
    event: int
    level: AlarmLevel
    kind: AlarmKind
    channel: str
    lowest_frequency: float
    highest_frequency: float
    since_repeat: int
    sentence: str
    action: AlarmAction
    measure: str
    size: float
    found: int
    def __init__(self, repeat: _Optional[int] = ..., event: _Optional[int] = ..., level: _Optional[_Union[AlarmLevel, str]] = ..., kind: _Optional[_Union[AlarmKind, str]] = ..., channel: _Optional[str] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., since_repeat: _Optional[int] = ..., sentence: _Optional[str] = ..., action: _Optional[_Union[AlarmAction, str]] = ..., measure: _Optional[str] = ..., size: _Optional[float] = ..., found: _Optional[int] = ...) -> None: ...

class EnduranceRepeat(_message.Message):
    __slots__ = ("repeat", "event", "drive", "run", "end", "reason", "statistics", "damage", "alarms", "signal_epoch", "signal_blocks", "samples_hash", "measures", "baseline", "warnings", "lag")
    REPEAT_FIELD_NUMBER: _ClassVar[int]
    EVENT_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    STATISTICS_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_FIELD_NUMBER: _ClassVar[int]
    ALARMS_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_HASH_FIELD_NUMBER: _ClassVar[int]
    MEASURES_FIELD_NUMBER: _ClassVar[int]
    BASELINE_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    LAG_FIELD_NUMBER: _ClassVar[int]
    repeat: int
    event: int
    drive: int
    run: str
    end: RepeatEnd
    reason: str
    statistics: _array_pb2.Array
    damage: _array_pb2.Array
    alarms: _containers.RepeatedCompositeFieldContainer[EnduranceAlarm]
    signal_epoch: int
    signal_blocks: int
    samples_hash: str
    measures: _array_pb2.Array
    baseline: bytes
    warnings: _containers.RepeatedScalarFieldContainer[str]
    lag: float
    def __init__(self, repeat: _Optional[int] = ..., event: _Optional[int] = ..., drive: _Optional[int] = ..., run: _Optional[str] = ..., end: _Optional[_Union[RepeatEnd, str]] = ..., reason: _Optional[str] = ..., statistics: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., alarms: _Optional[_Iterable[_Union[EnduranceAlarm, _Mapping]]] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ..., samples_hash: _Optional[str] = ..., measures: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., baseline: _Optional[bytes] = ..., warnings: _Optional[_Iterable[str]] = ..., lag: _Optional[float] = ...) -> None: ...

class RepeatSamples(_message.Message):
    __slots__ = ("repeat", "event", "drive", "run", "response", "reason")
    REPEAT_FIELD_NUMBER: _ClassVar[int]
    EVENT_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    repeat: int
    event: int
    drive: int
    run: str
    response: _array_pb2.Record
    reason: str
    def __init__(self, repeat: _Optional[int] = ..., event: _Optional[int] = ..., drive: _Optional[int] = ..., run: _Optional[str] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., reason: _Optional[str] = ...) -> None: ...

class EnduranceDrive(_message.Message):
    __slots__ = ("event", "number", "drive", "campaign")
    EVENT_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    CAMPAIGN_FIELD_NUMBER: _ClassVar[int]
    event: int
    number: int
    drive: _array_pb2.Record
    campaign: str
    def __init__(self, event: _Optional[int] = ..., number: _Optional[int] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., campaign: _Optional[str] = ...) -> None: ...

class CorrectionPlanned(_message.Message):
    __slots__ = ("event", "campaign")
    EVENT_FIELD_NUMBER: _ClassVar[int]
    CAMPAIGN_FIELD_NUMBER: _ClassVar[int]
    event: int
    campaign: str
    def __init__(self, event: _Optional[int] = ..., campaign: _Optional[str] = ...) -> None: ...

class EnduranceCorrection(_message.Message):
    __slots__ = ("event", "campaign", "playbacks", "unknown", "damage", "reason", "next_repeat")
    EVENT_FIELD_NUMBER: _ClassVar[int]
    CAMPAIGN_FIELD_NUMBER: _ClassVar[int]
    PLAYBACKS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    NEXT_REPEAT_FIELD_NUMBER: _ClassVar[int]
    event: int
    campaign: str
    playbacks: int
    unknown: int
    damage: _array_pb2.Array
    reason: str
    next_repeat: int
    def __init__(self, event: _Optional[int] = ..., campaign: _Optional[str] = ..., playbacks: _Optional[int] = ..., unknown: _Optional[int] = ..., damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., reason: _Optional[str] = ..., next_repeat: _Optional[int] = ...) -> None: ...

class EventProgress(_message.Message):
    __slots__ = ("name", "planned", "played", "unknown", "damage", "measured", "drive", "measured_damage", "correction_playbacks", "correction_damage")
    NAME_FIELD_NUMBER: _ClassVar[int]
    PLANNED_FIELD_NUMBER: _ClassVar[int]
    PLAYED_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_FIELD_NUMBER: _ClassVar[int]
    MEASURED_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    MEASURED_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_PLAYBACKS_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    name: str
    planned: int
    played: int
    unknown: int
    damage: _array_pb2.Array
    measured: int
    drive: int
    measured_damage: _array_pb2.Array
    correction_playbacks: int
    correction_damage: _array_pb2.Array
    def __init__(self, name: _Optional[str] = ..., planned: _Optional[int] = ..., played: _Optional[int] = ..., unknown: _Optional[int] = ..., damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., measured: _Optional[int] = ..., drive: _Optional[int] = ..., measured_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., correction_playbacks: _Optional[int] = ..., correction_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class EnduranceVolume(_message.Message):
    __slots__ = ("id", "rig", "number", "first_repeat", "columns", "events", "monitor", "baselines", "alarms", "kept_before", "drives", "holds", "kept")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    FIRST_REPEAT_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    MONITOR_FIELD_NUMBER: _ClassVar[int]
    BASELINES_FIELD_NUMBER: _ClassVar[int]
    ALARMS_FIELD_NUMBER: _ClassVar[int]
    KEPT_BEFORE_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    HOLDS_FIELD_NUMBER: _ClassVar[int]
    KEPT_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    number: int
    first_repeat: int
    columns: _containers.RepeatedScalarFieldContainer[str]
    events: _containers.RepeatedCompositeFieldContainer[EventProgress]
    monitor: bytes
    baselines: _containers.RepeatedScalarFieldContainer[bytes]
    alarms: int
    kept_before: int
    drives: _containers.RepeatedCompositeFieldContainer[EnduranceDrive]
    holds: int
    kept: int
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., number: _Optional[int] = ..., first_repeat: _Optional[int] = ..., columns: _Optional[_Iterable[str]] = ..., events: _Optional[_Iterable[_Union[EventProgress, _Mapping]]] = ..., monitor: _Optional[bytes] = ..., baselines: _Optional[_Iterable[bytes]] = ..., alarms: _Optional[int] = ..., kept_before: _Optional[int] = ..., drives: _Optional[_Iterable[_Union[EnduranceDrive, _Mapping]]] = ..., holds: _Optional[int] = ..., kept: _Optional[int] = ...) -> None: ...

class EnduranceHold(_message.Message):
    __slots__ = ("number", "next_repeat", "reason", "alarms")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    NEXT_REPEAT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    ALARMS_FIELD_NUMBER: _ClassVar[int]
    number: int
    next_repeat: int
    reason: str
    alarms: _containers.RepeatedCompositeFieldContainer[EnduranceAlarm]
    def __init__(self, number: _Optional[int] = ..., next_repeat: _Optional[int] = ..., reason: _Optional[str] = ..., alarms: _Optional[_Iterable[_Union[EnduranceAlarm, _Mapping]]] = ...) -> None: ...

class EnduranceDecision(_message.Message):
    __slots__ = ("hold", "kind", "name", "reason", "decided")
    HOLD_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DECIDED_FIELD_NUMBER: _ClassVar[int]
    hold: int
    kind: EnduranceDecisionKind
    name: str
    reason: str
    decided: int
    def __init__(self, hold: _Optional[int] = ..., kind: _Optional[_Union[EnduranceDecisionKind, str]] = ..., name: _Optional[str] = ..., reason: _Optional[str] = ..., decided: _Optional[int] = ...) -> None: ...

class EnduranceEvent(_message.Message):
    __slots__ = ("status",)
    STATUS_FIELD_NUMBER: _ClassVar[int]
    status: EnduranceStatus
    def __init__(self, status: _Optional[_Union[EnduranceStatus, _Mapping]] = ...) -> None: ...

class EnduranceRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class EnduranceStatus(_message.Message):
    __slots__ = ("id", "rig", "phase", "activity", "repeats", "played", "unknown", "remaining_seconds", "events", "responses", "damage", "damage_planned_so_far", "damage_planned", "alarms", "last_alarms", "last_repeat", "last_event", "last_statistics", "columns", "hold", "recordings", "recording", "remarks", "fault", "kept", "correction_playbacks", "correction_damage")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    ACTIVITY_FIELD_NUMBER: _ClassVar[int]
    REPEATS_FIELD_NUMBER: _ClassVar[int]
    PLAYED_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_FIELD_NUMBER: _ClassVar[int]
    REMAINING_SECONDS_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_PLANNED_SO_FAR_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_PLANNED_FIELD_NUMBER: _ClassVar[int]
    ALARMS_FIELD_NUMBER: _ClassVar[int]
    LAST_ALARMS_FIELD_NUMBER: _ClassVar[int]
    LAST_REPEAT_FIELD_NUMBER: _ClassVar[int]
    LAST_EVENT_FIELD_NUMBER: _ClassVar[int]
    LAST_STATISTICS_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    HOLD_FIELD_NUMBER: _ClassVar[int]
    RECORDINGS_FIELD_NUMBER: _ClassVar[int]
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    REMARKS_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    KEPT_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_PLAYBACKS_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    phase: EndurancePhase
    activity: str
    repeats: int
    played: int
    unknown: int
    remaining_seconds: float
    events: _containers.RepeatedCompositeFieldContainer[EventProgress]
    responses: _containers.RepeatedScalarFieldContainer[str]
    damage: _array_pb2.Array
    damage_planned_so_far: _array_pb2.Array
    damage_planned: _array_pb2.Array
    alarms: int
    last_alarms: _containers.RepeatedCompositeFieldContainer[EnduranceAlarm]
    last_repeat: int
    last_event: int
    last_statistics: _array_pb2.Array
    columns: _containers.RepeatedScalarFieldContainer[str]
    hold: EnduranceHold
    recordings: int
    recording: str
    remarks: _containers.RepeatedScalarFieldContainer[str]
    fault: _query_pb2.Fault
    kept: int
    correction_playbacks: int
    correction_damage: _array_pb2.Array
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., phase: _Optional[_Union[EndurancePhase, str]] = ..., activity: _Optional[str] = ..., repeats: _Optional[int] = ..., played: _Optional[int] = ..., unknown: _Optional[int] = ..., remaining_seconds: _Optional[float] = ..., events: _Optional[_Iterable[_Union[EventProgress, _Mapping]]] = ..., responses: _Optional[_Iterable[str]] = ..., damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., damage_planned_so_far: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., damage_planned: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., alarms: _Optional[int] = ..., last_alarms: _Optional[_Iterable[_Union[EnduranceAlarm, _Mapping]]] = ..., last_repeat: _Optional[int] = ..., last_event: _Optional[int] = ..., last_statistics: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., columns: _Optional[_Iterable[str]] = ..., hold: _Optional[_Union[EnduranceHold, _Mapping]] = ..., recordings: _Optional[int] = ..., recording: _Optional[str] = ..., remarks: _Optional[_Iterable[str]] = ..., fault: _Optional[_Union[_query_pb2.Fault, _Mapping]] = ..., kept: _Optional[int] = ..., correction_playbacks: _Optional[int] = ..., correction_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class StopEnduranceRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class HoldEnduranceRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class ResumeEnduranceRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...
