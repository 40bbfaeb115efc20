"""Malformed messages of every kind, made from the descriptors of the contract and a seed."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import StrEnum

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

FLOATS = (float("nan"), float("inf"), float("-inf"), -1.0, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e18, -1e-9)
"""What a figure should not be, mostly."""

TEXTS = (
    "",
    "/",
    "..",
    "../../etc/passwd",
    "*",
    "**",
    "@replay",
    "a/b",
    "A B",
    "\x00",
    "\n",
    "ä" * 60,
    "x" * 121,
    "x" * 100_000,
    "start",
    "list",
    "-",
    "{}%s",
)
_UNSIGNED = (0, 1, 2**31, 2**32 - 1)
_UNSIGNED_64 = (*_UNSIGNED, 2**53, 2**63, 2**64 - 1)
_ENUMS = (0, 99, -1, 2**31 - 1, -(2**31))
_SHAPES: tuple[tuple[int, ...], ...] = (
    (),
    (0,),
    (1,),
    (2**63,),
    (2**32, 2**32),
    (2**64 - 1, 1),
    (0, 2**60),
    (1,) * 64,
    (3, 5),
)
_DEPTH = 4
# Field number 2000 does not exist anywhere; wire type 2.
_LONG_UNKNOWN = (2000 << 3) | 2

Make = Callable[[Message, np.random.Generator], bytes]


class Malformation(StrEnum):
    """What is wrong with a message."""

    RANDOM_BYTES = "random bytes"
    TRUNCATED = "cut off"
    FLIPPED_BITS = "flipped bits"
    FALSE_LENGTHS = "false lengths"
    FLOATS = "NaN, infinite, negative and huge values"
    SHAPES = "wrong shapes"
    ENUMS = "unknown enumeration values"
    NAMES = "names, texts and numbers out of all bounds"
    MISSING = "missing fields"
    RANDOM_FIELDS = "random fields"


def malformed(template: Message, kind: Malformation, random: np.random.Generator) -> bytes:
    """Return the bytes of a message that has something wrong.

    Parameters
    ----------
    template : Message
        A sound one; it is left as it is.
    kind : Malformation
        What is to be wrong. Where the message has nothing of the kind, it has random fields instead.
    random : Generator
        Decides the rest.
    """
    return _MAKERS[kind](template, random)


def _random_bytes(_template: Message, random: np.random.Generator) -> bytes:
    return random.bytes(int(random.integers(1, 400)))


def _truncated(template: Message, random: np.random.Generator) -> bytes:
    whole = template.SerializeToString() or _random_fields(template, random)
    return whole[: int(random.integers(0, max(1, len(whole))))]


def _flipped_bits(template: Message, random: np.random.Generator) -> bytes:
    content = bytearray(template.SerializeToString() or _random_fields(template, random) or b"\0")
    # Near its beginning, where the structure is: most of a long message is samples.
    for place in random.integers(0, min(len(content), 400), size=int(random.integers(1, 6))):
        content[place] ^= 1 << int(random.integers(8))
    return bytes(content)


def _false_lengths(template: Message, random: np.random.Generator) -> bytes:
    content = template.SerializeToString()
    length = int(random.choice([2**31 - 1, 2**31, 2**32, 2**40, 2**62, 2**63]))
    fields = [field.number for field in template.DESCRIPTOR.fields] or [1]
    tag = int(random.choice([(int(random.choice(fields)) << 3) | 2, _LONG_UNKNOWN]))
    tail = _varint(tag) + _varint(length) + random.bytes(int(random.integers(0, 20)))
    return content[:4000] + tail if random.random() < 0.5 else tail + content[:4000]


def _varint(number: int) -> bytes:
    parts = bytearray()
    while number > 0x7F:
        parts.append((number & 0x7F) | 0x80)
        number >>= 7
    return bytes([*parts, number])


def _floats(template: Message, random: np.random.Generator) -> bytes:
    def spoil(message: Message, field: FieldDescriptor) -> bool:
        if field.type not in (FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT):
            if field.name == "data" and field.containing_type.name == "Array" and len(message.data) >= 8:
                data = bytearray(message.data)
                place = 8 * int(random.integers(len(data) // 8))
                data[place : place + 8] = struct.pack("<d", FLOATS[int(random.integers(len(FLOATS)))])
                message.data = bytes(data)
                return True
            return False
        return _set(message, field, FLOATS[int(random.integers(len(FLOATS)))])

    return _spoiled(template, random, spoil)


def _shapes(template: Message, random: np.random.Generator) -> bytes:
    def spoil(message: Message, field: FieldDescriptor) -> bool:
        if field.containing_type.name != "Array":
            return False
        if field.name == "shape":
            del message.shape[:]
            message.shape.extend(_SHAPES[int(random.integers(len(_SHAPES)))])
        elif field.name == "data":
            cut = int(random.integers(0, 20))
            message.data = message.data[:-cut] if random.random() < 0.5 else message.data + random.bytes(cut + 1)
        else:
            message.element_type = int(random.integers(0, 6))
        return True

    return _spoiled(template, random, spoil)


def _enums(template: Message, random: np.random.Generator) -> bytes:
    def spoil(message: Message, field: FieldDescriptor) -> bool:
        if field.type != FieldDescriptor.TYPE_ENUM:
            return False
        return _set(message, field, _ENUMS[int(random.integers(len(_ENUMS)))])

    return _spoiled(template, random, spoil)


def _names(template: Message, random: np.random.Generator) -> bytes:
    def spoil(message: Message, field: FieldDescriptor) -> bool:
        if field.type == FieldDescriptor.TYPE_STRING:
            return _set(message, field, TEXTS[int(random.integers(len(TEXTS)))])
        if field.containing_type.name != "Array" and field.type in _BOUNDS:
            bounds = _BOUNDS[field.type]
            return _set(message, field, bounds[int(random.integers(len(bounds)))])
        return False

    return _spoiled(template, random, spoil)


def _missing(template: Message, random: np.random.Generator) -> bytes:
    def spoil(message: Message, field: FieldDescriptor) -> bool:
        message.ClearField(field.name)
        return True

    return _spoiled(template, random, spoil)


def _random_fields(template: Message, random: np.random.Generator) -> bytes:
    return random_message(template.DESCRIPTOR, random).SerializeToString()


_BOUNDS = {
    FieldDescriptor.TYPE_UINT32: _UNSIGNED,
    FieldDescriptor.TYPE_UINT64: _UNSIGNED_64,
    FieldDescriptor.TYPE_INT32: (0, -1, 2**31 - 1, -(2**31)),
    FieldDescriptor.TYPE_INT64: (0, -1, 2**63 - 1, -(2**63)),
    FieldDescriptor.TYPE_FIXED64: _UNSIGNED_64,
    FieldDescriptor.TYPE_BOOL: (False, True),
}

_MAKERS: dict[Malformation, Make] = {
    Malformation.RANDOM_BYTES: _random_bytes,
    Malformation.TRUNCATED: _truncated,
    Malformation.FLIPPED_BITS: _flipped_bits,
    Malformation.FALSE_LENGTHS: _false_lengths,
    Malformation.FLOATS: _floats,
    Malformation.SHAPES: _shapes,
    Malformation.ENUMS: _enums,
    Malformation.NAMES: _names,
    Malformation.MISSING: _missing,
    Malformation.RANDOM_FIELDS: _random_fields,
}

Spoil = Callable[[Message, FieldDescriptor], bool]


def _spoiled(template: Message, random: np.random.Generator, spoil: Spoil) -> bytes:
    """Return a copy with one of its fields spoiled, at any depth; random fields where it has none of the kind."""
    message = type(template)()
    message.CopyFrom(template)
    places = list(_fields_of(message))
    for place in random.permutation(len(places)):
        if spoil(*places[place]):
            return message.SerializeToString()
    return _random_fields(template, random)


def _fields_of(message: Message) -> list[tuple[Message, FieldDescriptor]]:
    found: list[tuple[Message, FieldDescriptor]] = []
    for field in message.DESCRIPTOR.fields:
        found.append((message, field))
        if field.type == FieldDescriptor.TYPE_MESSAGE:
            value = getattr(message, field.name)
            # The first of many: the twentieth channel is checked as the first one is.
            below = list(value[:2]) if _many(field) else [value] if message.HasField(field.name) else []
            for each in below:
                found.extend(_fields_of(each))
    return found


def _set(message: Message, field: FieldDescriptor, value: object) -> bool:
    if _many(field):
        getattr(message, field.name).append(value)
    else:
        setattr(message, field.name, value)
    return True


def _many(field: FieldDescriptor) -> bool:
    return bool(field.is_repeated)


def random_message(descriptor: Descriptor, random: np.random.Generator, depth: int = 0) -> Message:
    """Return a message that parses and means nothing: any of its fields, each with an odd value."""
    message: Message = GetMessageClass(descriptor)()
    for field in descriptor.fields:
        if random.random() < 0.4:
            continue
        for _ in range(int(random.integers(1, 4)) if _many(field) else 1):
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                if depth < _DEPTH:
                    below = random_message(field.message_type, random, depth + 1)
                    if _many(field):
                        getattr(message, field.name).append(below)
                    else:
                        getattr(message, field.name).CopyFrom(below)
                continue
            _set(message, field, _odd_value(field, random))
    return message


def _odd_value(field: FieldDescriptor, random: np.random.Generator) -> object:
    if field.type in (FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT):
        return FLOATS[int(random.integers(len(FLOATS)))]
    if field.type == FieldDescriptor.TYPE_STRING:
        return TEXTS[int(random.integers(len(TEXTS)))]
    if field.type == FieldDescriptor.TYPE_BYTES:
        return random.bytes(int(random.integers(0, 64)))
    if field.type == FieldDescriptor.TYPE_ENUM:
        return _ENUMS[int(random.integers(len(_ENUMS)))]
    bounds = _BOUNDS[field.type]
    return bounds[int(random.integers(len(bounds)))]
