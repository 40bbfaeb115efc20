"""Conversion of a message to the model of its settings and back, by the names of the fields.

A field of the model is the field of the message with the same name. Enums are matched by name, a range `x` is the two
fields `smallest_x` and `largest_x`, and None is an omitted field, or the value that `Wire` states.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from enum import Enum
from typing import Any, Final, TypeVar, Union, cast, get_args, get_origin

import numpy as np
from google.protobuf.descriptor import EnumDescriptor, FieldDescriptor
from google.protobuf.message import Message
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.v1 import array_pb2
from duralab_settings.values import SettingsError, Wire
from duralab_settings.wording import explained

LARGEST_ARRAY: Final = 100_000
"""Largest number of elements of an array of settings; far above the needs of any rig."""

__all__ = ["LARGEST_ARRAY", "fill_message", "from_message", "message_fields"]

S = TypeVar("S", bound=BaseModel)


def from_message(message: Message, model: type[S], *, field: str = "") -> S:
    """Return the settings in a message, checked.

    Parameters
    ----------
    message : Message
        Message as received; nothing in it is trusted. It may have fields that the model does not have.
    model : type
        Model of the settings.
    field : str
        Path of the message, for errors, e.g. "excitation"; empty for a whole request.

    Returns
    -------
    BaseModel
        Instance of `model`.

    Raises
    ------
    SettingsError
        If a value is not allowed; with the path of its field.
    """
    values = dict(_values(message, model, path=f"{field}." if field else ""))
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise explained(error, model, prefix=field) from error


def fill_message(message: Message, settings: BaseModel, *, model: type[BaseModel] | None = None) -> None:
    """Write settings into a message; fields that the model does not have are not changed.

    Parameters
    ----------
    message : Message
        Message with all fields of the settings.
    settings : BaseModel
        Settings from `from_message`.
    model : type, optional
        Base of the settings' model; only its fields are written.
    """
    for name, info in (model or type(settings)).model_fields.items():
        value, wire = getattr(settings, name), _wire(info)
        for field, part in _parts(message, name, value):
            if part is None:
                if wire.none:
                    setattr(message, field.name, wire.none)
            elif field.message_type is not None and field.message_type.full_name == "duralab.v1.Array":
                getattr(message, field.name).CopyFrom(to_array(np.array(part, dtype=np.float64)))
            elif isinstance(part, BaseModel):
                fill_message(getattr(message, field.name), part)
                getattr(message, field.name).SetInParent()
            elif isinstance(part, tuple):
                _fill_repeated(message, field, part)
            elif field.enum_type is not None:
                setattr(message, field.name, _number(field.enum_type, part))
            else:
                setattr(message, field.name, part.value if isinstance(part, Enum) else part)


def message_fields(message: Message | type[Message], name: str) -> tuple[FieldDescriptor, ...]:
    """Return the fields of a message for a field of its model.

    Parameters
    ----------
    message : Message
        Message or its type.
    name : str
        Name of the model's field.

    Returns
    -------
    tuple of FieldDescriptor
        Field of the same name, or the two of a range.

    Raises
    ------
    LookupError
        If the message has no such field.
    """
    found = message.DESCRIPTOR.fields_by_name
    names = (name,) if name in found else (f"smallest_{name}", f"largest_{name}")
    if missing := [each for each in names if each not in found]:
        raise LookupError(f"{message.DESCRIPTOR.full_name} has neither {name} nor {' and '.join(missing)}.")
    # The stubs allow a field type of the implementation, which has the same attributes.
    return tuple(cast(FieldDescriptor, found[each]) for each in names)


def _parts(message: Message, name: str, value: Any) -> Iterator[tuple[FieldDescriptor, Any]]:
    first, *others = message_fields(message, name)
    if others:
        yield from zip((first, *others), value or (None, None), strict=True)
    else:
        yield first, value


def _fill_repeated(message: Message, field: FieldDescriptor, values: tuple[Any, ...]) -> None:
    target = getattr(message, field.name)
    if field.message_type is None:
        target.extend(values)
    else:
        for value in values:
            fill_message(target.add(), value)


def _values(message: Message, model: type[BaseModel], *, path: str) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a model that are set in a message."""
    for name, info in model.model_fields.items():
        field, *others = message_fields(message, name)
        if others:
            bounds = tuple(getattr(message, each.name) for each in (field, *others))
            if any(bounds):
                yield name, bounds
            continue
        if field.message_type is not None:
            yield from _of_messages(message, field, info, path=f"{path}{name}")
        elif field.is_repeated:
            values = tuple(getattr(message, name))
            yield name, None if not values and _is_optional(info.annotation) else values
        elif field.has_presence and not message.HasField(name):
            yield name, None
        else:
            value, wire = getattr(message, name), _wire(info)
            if value == 0 and not isinstance(value, bool) and wire.zero is not None:
                yield name, wire.zero
            elif not field.has_presence and _is_optional(info.annotation) and value == wire.none:
                yield name, None
            elif field.enum_type is not None:
                yield name, _member(field.enum_type, value, info.annotation, path=f"{path}{name}")
            else:
                # For the exponents of an S-N line, which are whole numbers in the model.
                whole = _enum_of(info.annotation) is not None and isinstance(value, float) and value.is_integer()
                yield name, int(value) if whole else value


def _section_of(annotation: Any) -> type[BaseModel] | None:
    """Return the section of a field, one or many of them; None if it holds single values."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for inner in get_args(annotation) if (found := _section_of(inner)) is not None), None)


def _of_messages(message: Message, field: FieldDescriptor, info: FieldInfo, *, path: str) -> Iterator[tuple[str, Any]]:
    name, section = field.name, _section_of(info.annotation)
    if section is not None and field.is_repeated:
        items = enumerate(getattr(message, name))
        yield name, tuple(from_message(item, section, field=f"{path}.{index}") for index, item in items)
    elif not message.HasField(name):
        return
    elif section is not None:
        yield name, from_message(getattr(message, name), section, field=path)
    else:
        yield name, _tuples(getattr(message, name), axes=_axes(info.annotation), path=path)


def _tuples(array: array_pb2.Array, *, axes: int, path: str) -> tuple[Any, ...]:
    try:
        values = from_array(array, field=path, shape=(None,) * axes, dtype=np.float64)
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
    if values.size > LARGEST_ARRAY:
        raise SettingsError(f"{path} has {values.size} values; at most {LARGEST_ARRAY} are allowed.", field=path)
    return _nested(values.tolist())


def _nested(values: list[Any]) -> tuple[Any, ...]:
    return tuple(_nested(value) if isinstance(value, list) else value for value in values)


def _wire(info: FieldInfo) -> Wire:
    return next((each for each in info.metadata if isinstance(each, Wire)), Wire())


def _is_optional(annotation: Any) -> bool:
    return get_origin(annotation) in (types.UnionType, Union) and type(None) in get_args(annotation)


def _enum_of(annotation: Any) -> type[Enum] | None:
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return annotation
    return next((found for inner in get_args(annotation) if (found := _enum_of(inner)) is not None), None)


def _axes(annotation: Any) -> int:
    """Return the number of axes of nested tuples."""
    inner = max((_axes(each) for each in get_args(annotation)), default=0)
    return inner + 1 if get_origin(annotation) is tuple else inner


def _prefix(kind: EnumDescriptor) -> str:
    return kind.values_by_number[0].name.removesuffix("UNSPECIFIED")


def _number(kind: EnumDescriptor, member: Enum) -> int:
    return kind.values_by_name[f"{_prefix(kind)}{member.name}"].number


def _member(kind: EnumDescriptor, number: int, annotation: Any, *, path: str) -> Enum:
    offered = {_number(kind, member): member for member in annotation}
    if number not in offered:
        names = ", ".join(f"{member.name} ({known})" for known, member in offered.items())
        raise SettingsError(f"{path} is {number}; offered are {names}.", field=path)
    return offered[number]
