from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class FaultCode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FAULT_CODE_UNSPECIFIED: _ClassVar[FaultCode]
    FAULT_CODE_INVALID_ARGUMENT: _ClassVar[FaultCode]
    FAULT_CODE_NOT_FOUND: _ClassVar[FaultCode]
    FAULT_CODE_ALREADY_EXISTS: _ClassVar[FaultCode]
    FAULT_CODE_BUSY: _ClassVar[FaultCode]
    FAULT_CODE_FAILED_PRECONDITION: _ClassVar[FaultCode]
    FAULT_CODE_CANCELLED: _ClassVar[FaultCode]
    FAULT_CODE_UNAVAILABLE: _ClassVar[FaultCode]
    FAULT_CODE_DEADLINE_EXCEEDED: _ClassVar[FaultCode]
    FAULT_CODE_DATA_LOSS: _ClassVar[FaultCode]
    FAULT_CODE_INTERNAL: _ClassVar[FaultCode]
    FAULT_CODE_UNIMPLEMENTED: _ClassVar[FaultCode]
    FAULT_CODE_RESOURCE_EXHAUSTED: _ClassVar[FaultCode]
    FAULT_CODE_PERMISSION_DENIED: _ClassVar[FaultCode]
FAULT_CODE_UNSPECIFIED: FaultCode
FAULT_CODE_INVALID_ARGUMENT: FaultCode
FAULT_CODE_NOT_FOUND: FaultCode
FAULT_CODE_ALREADY_EXISTS: FaultCode
FAULT_CODE_BUSY: FaultCode
FAULT_CODE_FAILED_PRECONDITION: FaultCode
FAULT_CODE_CANCELLED: FaultCode
FAULT_CODE_UNAVAILABLE: FaultCode
FAULT_CODE_DEADLINE_EXCEEDED: FaultCode
FAULT_CODE_DATA_LOSS: FaultCode
FAULT_CODE_INTERNAL: FaultCode
FAULT_CODE_UNIMPLEMENTED: FaultCode
FAULT_CODE_RESOURCE_EXHAUSTED: FaultCode
FAULT_CODE_PERMISSION_DENIED: FaultCode

class Fault(_message.Message):
    __slots__ = ("code", "message", "field", "service")
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    SERVICE_FIELD_NUMBER: _ClassVar[int]
    code: FaultCode
    message: str
    field: str
    service: str
    def __init__(self, code: _Optional[_Union[FaultCode, str]] = ..., message: _Optional[str] = ..., field: _Optional[str] = ..., service: _Optional[str] = ...) -> None: ...

class Progress(_message.Message):
    __slots__ = ("phase", "fraction", "remaining_seconds", "detail")
    PHASE_FIELD_NUMBER: _ClassVar[int]
    FRACTION_FIELD_NUMBER: _ClassVar[int]
    REMAINING_SECONDS_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    phase: str
    fraction: float
    remaining_seconds: float
    detail: str
    def __init__(self, phase: _Optional[str] = ..., fraction: _Optional[float] = ..., remaining_seconds: _Optional[float] = ..., detail: _Optional[str] = ...) -> None: ...
