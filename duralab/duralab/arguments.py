"""Checks of a script's arguments, before any request is sent or any rig moves.

`pydantic.validate_call` is not used: it resolves annotations on import, so that xarray would be imported as well,
accepts True as a number, and its errors do not state the remedy.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

import numpy as np

from duralab.errors import InputError

_REAL_KINDS: Final = "iuf"

_IN_WORDS: Final = MappingProxyType({"c": "complex numbers", "b": "truth values", "U": "text", "S": "bytes"})

T = TypeVar("T")


def whole_number(value: object) -> bool:
    """Return whether a value is an integer, also of numpy, but not True or False."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_text(value: object, *, field: str) -> None:
    """Refuse a value that is not a string."""
    if not isinstance(value, str):
        raise InputError(f"{field} is {value!r}; give a text.", field=field)


def require_switch(value: object, *, field: str) -> None:
    """Refuse a value other than True and False, also of numpy."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{field} is {value!r}; give True or False.", field=field)


def folder_of(given: str | Path | None, *, usual: Path, field: str = "out") -> Path:
    """Return the given folder, or the usual one if none is given; refuse a value that is not a path."""
    require_path(given, of="a folder", field=field)
    return usual if given is None else Path(given)


def require_path(given: object, *, of: str, field: str) -> None:
    """Refuse a value that is neither a path nor None; `of` names the kind of path, e.g. "a folder"."""
    if given is not None and not isinstance(given, str | os.PathLike):
        raise InputError(f"{field} is {given!r}; give the path of {of}, a text or a pathlib.Path.", field=field)


def progress_callback(on_progress: Callable[[T], None] | None) -> Callable[[T], None]:
    """Return the progress callback, or a no-op if none was given; refuse a value that is not callable."""
    if on_progress is None:
        return _ignore
    if not callable(on_progress):
        # Without this check the error would come at the first progress report, when the rig already moves.
        raise InputError(
            f"on_progress is {on_progress!r}; give a function of one argument, or leave it out.", field="on_progress"
        )
    return on_progress


def _ignore(progress: object) -> None:
    """Do nothing."""
    del progress


def real_numbers(values: object, *, what: str, field: str) -> np.ndarray:
    """Return real numbers as float64."""
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{what} is no array; give one whose rows have the same length.", field=field) from error
    if given.dtype.kind not in _REAL_KINDS:
        # numpy would drop the imaginary part with only a warning, and parse numbers from strings.
        held = _IN_WORDS.get(given.dtype.kind, f"values of type {given.dtype}")
        raise InputError(f"{what} holds {held}; give an array of real numbers, such as float64.", field=field)
    _require_plain(values, what=what, field=field)
    return np.ascontiguousarray(given, dtype=np.float64)


def _require_plain(values: object, *, what: str, field: str) -> None:
    """Refuse a mask, and a unit as in pint, astropy and xarray: numpy would remove both without an error."""
    masked = int(np.ma.count_masked(values)) if isinstance(values, np.ma.MaskedArray) else 0
    if masked:
        raise InputError(
            f"{what} has {masked} masked values, which are no numbers; fill them in before.",
            field=field,
        )
    for name in ("units", "unit"):
        if hasattr(values, name):
            unit = getattr(values, name)
            carried = f"the unit {unit}" if np.ndim(unit) == 0 else "units"
            raise InputError(
                f"{what} carries {carried}, which is read of named channels only; give `Signals` or an xarray with "
                "names and units, or plain numbers in the rig's units.",
                field=field,
            )


def require_seed(seed: int) -> None:
    """Refuse a seed outside 0 to 2^63 - 1, the range of `Seed` in a campaign file."""
    if not (whole_number(seed) and 0 <= seed < 2**63):
        raise InputError(f"The seed is {seed!r}; it must be a whole number from 0 to 2^63 - 1.", field="seed")
