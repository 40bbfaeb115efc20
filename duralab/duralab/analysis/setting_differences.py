"""Settings in which recorded campaigns differ."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from google.protobuf.descriptor import EnumDescriptor, FieldDescriptor
from google.protobuf.message import Message

from duralab_proto.arrays import from_array
from duralab_proto.v1 import array_pb2

if TYPE_CHECKING:
    from duralab.recording import Recording

NOT_SET: Final = "–"
"""Text for a setting that a recording does not have."""

_NO_SETTINGS: Final = frozenset({"id", "target", "target_drive", "scenario"})
"""Fields that are not compared: name, signals, and the file's text, which repeats the other fields."""

_LONGEST_ARRAY: Final = 12


@dataclass(frozen=True)
class SettingDifference:
    """Setting that is not equal in all recordings.

    `setting`: Name of the setting, e.g. "update.iteration_gain"; "target" is the target's samples. `values`: Value in
    each recording, as text; a dash if it has none.
    """

    setting: str
    values: tuple[str, ...]


def differing_settings(recordings: Sequence[Recording]) -> tuple[SettingDifference, ...]:
    """Return the settings that differ, in the order of the contract."""
    settings = [_settings(recording) for recording in recordings]
    named = dict.fromkeys(name for found in settings for name in found)
    rows = [SettingDifference(name, tuple(found.get(name, NOT_SET) for found in settings)) for name in named]
    return tuple(row for row in rows if len(set(row.values)) > 1)


def _settings(recording: Recording) -> dict[str, str]:
    specification, rig = recording.specification, recording.rig
    # Compare a target's samples: two sources may give the same samples, and one source different ones.
    target = specification.target
    digest = hashlib.sha256(target.samples.data).hexdigest()
    found = {"target": f"{target.samples.shape[-1]} samples at {target.sample_rate:g} Hz, sha256 {digest[:16]}"}
    found |= dict(_flattened(specification, prefix=""))
    found["rig.engine"] = f"{rig.engine} {rig.version}"
    found["rig.content"] = f"sha256 {rig.content_hash[:16]}"
    for name, entries in recording.metadata.items():
        found |= {f"{name}.{key}": value for key, value in entries.items() if "version" in f"{name}.{key}"}
    return found


def _flattened(message: Message, *, prefix: str) -> Iterator[tuple[str, str]]:
    """Yield all set fields of a message and of its nested messages, by their names."""
    for field, value in message.ListFields():
        if not prefix and field.name in _NO_SETTINGS:
            continue
        name = f"{prefix}{field.name}"
        if field.is_repeated:
            if field.message_type is None:
                words = [text for entry in value for _, text in _entry(field, entry, name=name)]
                yield name, ", ".join(words)
            else:
                for number, entry in enumerate(value, start=1):
                    yield from _entry(field, entry, name=f"{name}.{number}" if len(value) > 1 else name)
        else:
            yield from _entry(field, value, name=name)


def _entry(field: FieldDescriptor, value: object, *, name: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, array_pb2.Array):
        yield name, _array_in_words(value)
    elif isinstance(value, Message):
        yield from _flattened(value, prefix=f"{name}.")
    elif field.enum_type is not None and isinstance(value, int):
        yield name, _enum_in_words(field.enum_type, value)
    else:
        yield name, f"{value:g}" if isinstance(value, float) else str(value)


def _array_in_words(message: array_pb2.Array) -> str:
    values = from_array(message, field="array", shape=(None,) * len(message.shape), finite=False)
    if values.size > _LONGEST_ARRAY:
        return f"{'×'.join(str(size) for size in values.shape)}, sha256 {hashlib.sha256(message.data).hexdigest()[:16]}"
    flat = values.ravel()
    if flat.size and np.all(flat == flat[0]):
        return f"{flat[0]:g}"
    return ", ".join(f"{value:g}" for value in flat)


def _enum_in_words(kind: EnumDescriptor, value: int) -> str:
    """Return the name of an enum value without the common prefix, e.g. "adaptive modelling"."""
    entries = kind.values_by_number
    if value not in entries:
        return str(value)
    common = entries[0].name.removesuffix("UNSPECIFIED") if 0 in entries else ""
    return entries[value].name.removeprefix(common).replace("_", " ").lower()
