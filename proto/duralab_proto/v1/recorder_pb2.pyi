from duralab_proto.v1 import array_pb2 as _array_pb2
from duralab_proto.v1 import iterator_pb2 as _iterator_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class CommitRequest(_message.Message):
    __slots__ = ("recording", "step", "message_type", "payload")
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_TYPE_FIELD_NUMBER: _ClassVar[int]
    PAYLOAD_FIELD_NUMBER: _ClassVar[int]
    recording: str
    step: int
    message_type: str
    payload: bytes
    def __init__(self, recording: _Optional[str] = ..., step: _Optional[int] = ..., message_type: _Optional[str] = ..., payload: _Optional[bytes] = ...) -> None: ...

class CommitAck(_message.Message):
    __slots__ = ("recording", "step", "payload_hash")
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    PAYLOAD_HASH_FIELD_NUMBER: _ClassVar[int]
    recording: str
    step: int
    payload_hash: str
    def __init__(self, recording: _Optional[str] = ..., step: _Optional[int] = ..., payload_hash: _Optional[str] = ...) -> None: ...

class RunPlanned(_message.Message):
    __slots__ = ("run", "rig", "purpose", "not_kept")
    RUN_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    PURPOSE_FIELD_NUMBER: _ClassVar[int]
    NOT_KEPT_FIELD_NUMBER: _ClassVar[int]
    run: str
    rig: str
    purpose: str
    not_kept: bool
    def __init__(self, run: _Optional[str] = ..., rig: _Optional[str] = ..., purpose: _Optional[str] = ..., not_kept: _Optional[bool] = ...) -> None: ...

class RunPlayed(_message.Message):
    __slots__ = ("run", "rig", "epoch", "blocks")
    RUN_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    run: str
    rig: str
    epoch: int
    blocks: int
    def __init__(self, run: _Optional[str] = ..., rig: _Optional[str] = ..., epoch: _Optional[int] = ..., blocks: _Optional[int] = ...) -> None: ...

class RecordingClosed(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class ListRecordingsRequest(_message.Message):
    __slots__ = ("rig", "target", "begun_from", "begun_before", "phase", "outcome")
    RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    BEGUN_FROM_FIELD_NUMBER: _ClassVar[int]
    BEGUN_BEFORE_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    rig: str
    target: str
    begun_from: int
    begun_before: int
    phase: _iterator_pb2.CampaignPhase
    outcome: _iterator_pb2.Outcome
    def __init__(self, rig: _Optional[str] = ..., target: _Optional[str] = ..., begun_from: _Optional[int] = ..., begun_before: _Optional[int] = ..., phase: _Optional[_Union[_iterator_pb2.CampaignPhase, str]] = ..., outcome: _Optional[_Union[_iterator_pb2.Outcome, str]] = ...) -> None: ...

class RecordingList(_message.Message):
    __slots__ = ("recordings",)
    RECORDINGS_FIELD_NUMBER: _ClassVar[int]
    recordings: _containers.RepeatedCompositeFieldContainer[RecordingInfo]
    def __init__(self, recordings: _Optional[_Iterable[_Union[RecordingInfo, _Mapping]]] = ...) -> None: ...

class RecordingRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class RecordingInfo(_message.Message):
    __slots__ = ("recording", "steps", "bytes", "closed", "signal_blocks", "missing_blocks", "file", "file_hash", "ended", "rig", "target", "begun", "phase", "outcome", "files", "waiting", "pre_test")
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    BYTES_FIELD_NUMBER: _ClassVar[int]
    CLOSED_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    MISSING_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    FILE_FIELD_NUMBER: _ClassVar[int]
    FILE_HASH_FIELD_NUMBER: _ClassVar[int]
    ENDED_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    BEGUN_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    FILES_FIELD_NUMBER: _ClassVar[int]
    WAITING_FIELD_NUMBER: _ClassVar[int]
    PRE_TEST_FIELD_NUMBER: _ClassVar[int]
    recording: str
    steps: int
    bytes: int
    closed: bool
    signal_blocks: int
    missing_blocks: int
    file: str
    file_hash: str
    ended: bool
    rig: str
    target: str
    begun: int
    phase: _iterator_pb2.CampaignPhase
    outcome: _iterator_pb2.Outcome
    files: _containers.RepeatedCompositeFieldContainer[RecordingFile]
    waiting: str
    pre_test: _iterator_pb2.PreTestVerdict
    def __init__(self, recording: _Optional[str] = ..., steps: _Optional[int] = ..., bytes: _Optional[int] = ..., closed: _Optional[bool] = ..., signal_blocks: _Optional[int] = ..., missing_blocks: _Optional[int] = ..., file: _Optional[str] = ..., file_hash: _Optional[str] = ..., ended: _Optional[bool] = ..., rig: _Optional[str] = ..., target: _Optional[str] = ..., begun: _Optional[int] = ..., phase: _Optional[_Union[_iterator_pb2.CampaignPhase, str]] = ..., outcome: _Optional[_Union[_iterator_pb2.Outcome, str]] = ..., files: _Optional[_Iterable[_Union[RecordingFile, _Mapping]]] = ..., waiting: _Optional[str] = ..., pre_test: _Optional[_Union[_iterator_pb2.PreTestVerdict, str]] = ...) -> None: ...

class RecordingFile(_message.Message):
    __slots__ = ("file", "bytes", "file_hash")
    FILE_FIELD_NUMBER: _ClassVar[int]
    BYTES_FIELD_NUMBER: _ClassVar[int]
    FILE_HASH_FIELD_NUMBER: _ClassVar[int]
    file: str
    bytes: int
    file_hash: str
    def __init__(self, file: _Optional[str] = ..., bytes: _Optional[int] = ..., file_hash: _Optional[str] = ...) -> None: ...

class ReadRecordingRequest(_message.Message):
    __slots__ = ("offset", "length", "part", "number")
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    offset: int
    length: int
    part: str
    number: int
    def __init__(self, offset: _Optional[int] = ..., length: _Optional[int] = ..., part: _Optional[str] = ..., number: _Optional[int] = ...) -> None: ...

class RecordingPart(_message.Message):
    __slots__ = ("offset", "data", "total")
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    offset: int
    data: bytes
    total: int
    def __init__(self, offset: _Optional[int] = ..., data: _Optional[bytes] = ..., total: _Optional[int] = ...) -> None: ...

class ReadStepsRequest(_message.Message):
    __slots__ = ("first", "with_samples")
    FIRST_FIELD_NUMBER: _ClassVar[int]
    WITH_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    first: int
    with_samples: bool
    def __init__(self, first: _Optional[int] = ..., with_samples: _Optional[bool] = ...) -> None: ...

class RecordedStep(_message.Message):
    __slots__ = ("step", "message_type", "payload", "drive", "response")
    STEP_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_TYPE_FIELD_NUMBER: _ClassVar[int]
    PAYLOAD_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    step: int
    message_type: str
    payload: bytes
    drive: _array_pb2.Array
    response: _array_pb2.Array
    def __init__(self, step: _Optional[int] = ..., message_type: _Optional[str] = ..., payload: _Optional[bytes] = ..., drive: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class RecordedSteps(_message.Message):
    __slots__ = ("steps", "total")
    STEPS_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    steps: _containers.RepeatedCompositeFieldContainer[RecordedStep]
    total: int
    def __init__(self, steps: _Optional[_Iterable[_Union[RecordedStep, _Mapping]]] = ..., total: _Optional[int] = ...) -> None: ...

class SignalWindowRequest(_message.Message):
    __slots__ = ("run", "first_second", "seconds", "channels")
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SECOND_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    run: str
    first_second: float
    seconds: float
    channels: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, run: _Optional[str] = ..., first_second: _Optional[float] = ..., seconds: _Optional[float] = ..., channels: _Optional[_Iterable[str]] = ...) -> None: ...

class SignalWindow(_message.Message):
    __slots__ = ("run", "first_sample", "drive", "response")
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    run: str
    first_sample: int
    drive: _array_pb2.Record
    response: _array_pb2.Record
    def __init__(self, run: _Optional[str] = ..., first_sample: _Optional[int] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ...) -> None: ...

class VerifyRecordingRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class VerifyResult(_message.Message):
    __slots__ = ("recording", "whole", "findings")
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    WHOLE_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    recording: str
    whole: bool
    findings: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, recording: _Optional[str] = ..., whole: _Optional[bool] = ..., findings: _Optional[_Iterable[str]] = ...) -> None: ...
