"""The schemas that are written into a log, so that any MCAP tool decodes its messages without this project."""

from __future__ import annotations

from typing import Any, Final

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message

from duralab_proto.v1 import array_pb2

_ARRAY: Final = array_pb2.Array.DESCRIPTOR
_DATA: Final = "data"
# A pair of doubles for each complex number.
_DOUBLES: Final = frozenset({array_pb2.ELEMENT_TYPE_FLOAT64, array_pb2.ELEMENT_TYPE_COMPLEX128})


def describe_schema(kind: type[Message], *, doubles: bool = False) -> bytes:
    """Return the serialised FileDescriptorSet of a message: its file and all that it imports, dependencies first."""
    # Of either implementation of the protobuf package, which share no type.
    files: dict[str, Any] = {}

    def visit(file: Any) -> None:
        for dependency in file.dependencies:
            visit(dependency)
        files.setdefault(file.name, file)

    visit(kind.DESCRIPTOR.file)
    described = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(described.file.add())
    if doubles:
        for file in described.file:
            for message in file.message_type:
                if file.name == _ARRAY.file.name and message.name == _ARRAY.name:
                    data = next(field for field in message.field if field.name == _DATA)
                    data.type = FieldDescriptorProto.TYPE_DOUBLE
                    data.label = FieldDescriptorProto.LABEL_REPEATED
    return described.SerializeToString(deterministic=True)


def holds_doubles_only(message: Message) -> bool:
    """Tell whether every array within a message is of float64 or complex128, so that its elements read as doubles.

    `message`: Of any depth.
    Returns: True also where it holds no array, or only empty ones.
    """
    if isinstance(message, array_pb2.Array):
        return not message.data or message.element_type in _DOUBLES
    for field, value in message.ListFields():
        if field.type != FieldDescriptor.TYPE_MESSAGE:
            continue
        inner = value if field.is_repeated else (value,)
        if not all(holds_doubles_only(each) for each in inner):
            return False
    return True
