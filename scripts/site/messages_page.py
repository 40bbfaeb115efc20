"""The messages' reference, from the comments of the contract."""

from __future__ import annotations

import tempfile
from pathlib import Path

from google.protobuf import descriptor_pb2
from grpc_tools import protoc
from table_cells import cell

PROTO = Path(__file__).resolve().parents[2] / "proto"
_Field = descriptor_pb2.FieldDescriptorProto
_File = descriptor_pb2.FileDescriptorProto
# Numbers of `message_type`, `enum_type`, `field`, `nested_type`, `value` in the path of a comment (descriptor.proto).
_MESSAGES, _ENUMS, _FIELDS, _VALUES = 4, 5, 2, 2
_FIRST_COMMENT = (12,)


def messages_page() -> str:
    """Return the page: every message and enumeration with its fields, numbers, types and comments."""
    parts = [
        "# Messages\n",
        "Every message of `duralab.v1`, made from the comments of the `.proto` files; which key carries which says the "
        "[contract](../contract.md). Fields are added, never renumbered; units are SI.\n",
    ]
    for file in _described():
        comments = {tuple(place.path): place for place in file.source_code_info.location}
        parts.append(f"## {Path(file.name).name}\n")
        detached = [text for path in (_FIRST_COMMENT, *comments) for text in _detached(comments, path)]
        parts += [f"{text}\n" for text in dict.fromkeys(detached)]
        for index, message in enumerate(file.message_type):
            parts += _message(message, comments, (_MESSAGES, index))
        for index, enumeration in enumerate(file.enum_type):
            parts += _enumeration(enumeration, comments, (_ENUMS, index))
    return "\n".join(parts)


def _described() -> list[_File]:
    names = sorted(path.relative_to(PROTO).as_posix() for path in PROTO.glob("duralab/v1/*.proto"))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "described")
        status = protoc.main(["protoc", f"-I{PROTO}", "--include_source_info", f"--descriptor_set_out={out}", *names])
        if status != 0:
            raise SystemExit(f"protoc ended with status {status}; the lines above say why.")
        return list(descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes()).file)


Comments = dict[tuple[int, ...], descriptor_pb2.SourceCodeInfo.Location]


def _comment(comments: Comments, path: tuple[int, ...]) -> str:
    place = comments.get(path)
    return "" if place is None else cell(f"{place.leading_comments} {place.trailing_comments}")


def _detached(comments: Comments, path: tuple[int, ...]) -> list[str]:
    place = comments.get(path)
    return [] if place is None else [cell(text) for text in place.leading_detached_comments]


def _message(message: descriptor_pb2.DescriptorProto, comments: Comments, path: tuple[int, ...]) -> list[str]:
    parts = [f"### {message.name} {{ #{message.name} }}\n", f"{_comment(comments, path)}\n"]
    if not message.field:
        return [*parts, "No fields.\n"]
    parts += ["| | field | type | |", "| ---: | --- | --- | --- |"]
    maps = {nested.name: nested for nested in message.nested_type if nested.options.map_entry}
    for index, field in enumerate(message.field):
        comment = _comment(comments, (*path, _FIELDS, index))
        if field.HasField("oneof_index") and not field.proto3_optional:
            comment = f"{comment} (one of `{message.oneof_decl[field.oneof_index].name}`)".strip()
        parts.append(f"| {field.number} | `{field.name}` | {_type(field, maps)} | {comment} |")
    return [*parts, ""]


def _enumeration(
    enumeration: descriptor_pb2.EnumDescriptorProto, comments: Comments, path: tuple[int, ...]
) -> list[str]:
    parts = [f"### {enumeration.name} {{ #{enumeration.name} }}\n", f"{_comment(comments, path)}\n"]
    parts += ["| | value | |", "| ---: | --- | --- |"]
    for index, value in enumerate(enumeration.value):
        comment = _comment(comments, (*path, _VALUES, index))
        parts.append(f"| {value.number} | `{value.name}` | {comment} |")
    return [*parts, ""]


def _type(field: _Field, maps: dict[str, descriptor_pb2.DescriptorProto]) -> str:
    name = field.type_name.rpartition(".")[2]
    if name in maps:
        key, value = maps[name].field
        return f"map of {_type(key, {})} to {_type(value, {})}"
    plain = _Field.Type.Name(field.type).removeprefix("TYPE_").lower()
    kind = f"[{name}](#{name})" if name else plain
    if field.label == _Field.LABEL_REPEATED:
        return f"list of {kind}"
    return f"{kind}, optional" if field.proto3_optional else kind
