"""Values that a script hands in, checked for their type before anything is asked or moved."""

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
    """Tell whether a value is a whole number, one of numpy's too; True and False are none."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_text(value: object, *, field: str) -> None:
    """Check a text.

    Parameters
    ----------
    value : object
        What was given.
    field : str
        The argument's name.

    Raises
    ------
    InputError
        It is no text.
    """
    if not isinstance(value, str):
        raise InputError(f"{field} is {value!r}; give a text.", field=field)


def require_switch(value: object, *, field: str) -> None:
    """Check a value that is True or False, numpy's too.

    Parameters
    ----------
    value : object
        What was given.
    field : str
        The argument's name.

    Raises
    ------
    InputError
        `value` is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{field} is {value!r}; give True or False.", field=field)


def folder_of(given: str | Path | None, *, usual: Path, field: str = "out") -> Path:
    """Return the folder that is given, or the usual one where none is.

    Parameters
    ----------
    given : str, Path or None
        What was given.
    usual : Path
        Where things go else.
    field : str
        The argument's name.

    Raises
    ------
    InputError
        It is no path.
    """
    require_path(given, of="a folder", field=field)
    return usual if given is None else Path(given)


def require_path(given: object, *, of: str, field: str) -> None:
    """Check a path that may be left out.

    Parameters
    ----------
    given : object
        What was given.
    of : str
        What the path is of, for the error.
    field : str
        The argument's name.

    Raises
    ------
    InputError
        It is neither a path nor None.
    """
    if given is not None and not isinstance(given, str | os.PathLike):
        raise InputError(f"{field} is {given!r}; give the path of {of}, a text or a pathlib.Path.", field=field)


def listener(on_progress: Callable[[T], None] | None) -> Callable[[T], None]:
    """Return what is told of the progress: the function that is given, or one that does nothing.

    Parameters
    ----------
    on_progress : callable or None
        What was given.

    Raises
    ------
    InputError
        It cannot be called.
    """
    if on_progress is None:
        return _tell_nobody
    if not callable(on_progress):
        # Found at the first progress, it would be found after the rig has begun to move.
        raise InputError(
            f"on_progress is {on_progress!r}; give a function of one argument, or leave it out.", field="on_progress"
        )
    return on_progress


def _tell_nobody(progress: object) -> None:
    """Do nothing with how far it is."""
    del progress


def real_numbers(values: object, *, what: str, field: str) -> np.ndarray:
    """Return real numbers as float64.

    Parameters
    ----------
    values : array_like
        Integers or floating-point numbers, of any shape.
    what : str
        Whose they are, the begin of a sentence.
    field : str
        Path of the value, for the error.

    Returns
    -------
    np.ndarray
        The same shape, contiguous; no copy where it is so already.

    Raises
    ------
    InputError
        They are complex, truth values, text or objects, masked or with a unit, or rows of several lengths.
    """
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{what} is no array; give one whose rows have the same length.", field=field) from error
    if given.dtype.kind not in _REAL_KINDS:
        # numpy would drop the imaginary part with no more than a warning, and read numbers out of text.
        held = _IN_WORDS.get(given.dtype.kind, f"values of type {given.dtype}")
        raise InputError(f"{what} holds {held}; give an array of real numbers, such as float64.", field=field)
    _require_plain(values, what=what, field=field)
    return np.ascontiguousarray(given, dtype=np.float64)


def _require_plain(values: object, *, what: str, field: str) -> None:
    """Refuse what numpy would strip off: a mask, and the unit of a quantity as pint, astropy and xarray carry one."""
    masked = int(np.ma.count_masked(values)) if isinstance(values, np.ma.MaskedArray) else 0
    if masked:
        raise InputError(
            f"{what} has {masked} masked values, which are no numbers; fill them in before.",
            field=field,
        )
    for name in ("units", "unit"):
        if hasattr(values, name):
            unit = getattr(values, name)
            told = f"the unit {unit}" if np.ndim(unit) == 0 else "units"
            raise InputError(
                f"{what} carries {told}, which is read of named channels only; give `Signals` or an xarray with names "
                "and units, or plain numbers in the rig's units.",
                field=field,
            )


def require_seed(seed: int) -> None:
    """Check a seed that comes from a script or an option, as `Seed` does one of a file.

    Parameters
    ----------
    seed : int
        0 to 2^63 - 1.

    Raises
    ------
    InputError
        It is another number, or none.
    """
    if not (whole_number(seed) and 0 <= seed < 2**63):
        raise InputError(f"The seed is {seed!r}; it must be a whole number from 0 to 2^63 - 1.", field="seed")
