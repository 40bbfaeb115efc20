from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class StreamHead(_message.Message):
    __slots__ = ("epoch", "first", "next", "marked", "done")
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    MARKED_FIELD_NUMBER: _ClassVar[int]
    DONE_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    first: int
    next: int
    marked: int
    done: bool
    def __init__(self, epoch: _Optional[int] = ..., first: _Optional[int] = ..., next: _Optional[int] = ..., marked: _Optional[int] = ..., done: _Optional[bool] = ...) -> None: ...

class StreamMark(_message.Message):
    __slots__ = ("epoch", "next")
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    next: int
    def __init__(self, epoch: _Optional[int] = ..., next: _Optional[int] = ...) -> None: ...
