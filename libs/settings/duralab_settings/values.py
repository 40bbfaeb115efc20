"""Types of single values, their form in a message, and the errors of values that are not allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag


class MisfitError(ValueError):
    """Value that does not fit the others of its section.

    Parameters
    ----------
    reason : str
        Half a sentence whose subject is the section: the value, the allowed values, the remedy.
    field : str
        Wrong key of the section.
    """

    def __init__(self, reason: str, *, field: str) -> None:
        super().__init__(reason)
        self.field = field


@dataclass(frozen=True)
class Wire:
    """Representation of a value in the message if it differs from the model; see `messages.fill_message`.

    `zero`: Value for 0 in the message; without it 0 is the value 0, and None if the model allows None. `none`: Value of
    the message for None.
    """

    zero: Any = None
    none: float = 0.0


def _as_tuple(value: Any) -> Any:
    """Return nested tuples for an array of numbers or a list, as in YAML; other values unchanged."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(_as_tuple(each) for each in value) if isinstance(value, list) else value


AS_TUPLE = BeforeValidator(_as_tuple)
"""Converts lists and arrays to a tuple."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Gain = Annotated[float, Field(gt=0, le=1)]
Level = Annotated[float, Field(gt=0, le=1e12)]
Count = Annotated[int, Field(ge=1, le=10_000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Gains = Annotated[tuple[Gain, ...], AS_TUPLE]
Range = Annotated[tuple[Positive, Positive], AS_TUPLE]
Ratios = Annotated[tuple[NotNegative, Positive], AS_TUPLE]

ONE_NUMBER, PER_CHANNEL = "one number", "per channel"
"""Two forms of a value for every channel; they appear in pydantic's locations, never in the file."""

_how_given = Discriminator(lambda value: PER_CHANNEL if isinstance(value, dict) else ONE_NUMBER)
PositivePerChannel = Annotated[
    Annotated[Positive, Tag(ONE_NUMBER)] | Annotated[dict[str, Positive], Tag(PER_CHANNEL)], _how_given
]
GainPerChannel = Annotated[Annotated[Gain, Tag(ONE_NUMBER)] | Annotated[dict[str, Gain], Tag(PER_CHANNEL)], _how_given]


def per_channel(value: float | Mapping[str, float], channels: Sequence[str], *, key: str) -> tuple[float, ...]:
    """Return one value for each channel, from one number or a mapping by name; raise `SettingsError` for a misfit."""
    if not isinstance(value, Mapping):
        return (float(value),) * len(channels)
    unknown, missing = (
        [name for name in value if name not in channels],
        [name for name in channels if name not in value],
    )
    if unknown or missing:
        found = [f"unknown channel {', '.join(unknown)}"] if unknown else []
        found += [f"no value for {', '.join(missing)}"] if missing else []
        raise SettingsError(
            f"{key} has {' and '.join(found)}; it needs one for each of {', '.join(channels)}.", field=key
        )
    return tuple(float(value[name]) for name in channels)


class SettingsError(ValueError):
    """Settings that are not allowed.

    Parameters
    ----------
    message : str
        One sentence: the value, the allowed values, the remedy.
    field : str
        Path of the wrong key, e.g. "excitation.duration".
    """

    def __init__(self, message: str, *, field: str) -> None:
        super().__init__(message)
        self.field = field
