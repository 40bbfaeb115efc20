"""Numbers from a script: real ones as float64, everything else refused before a part of it is lost."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

import numpy as np

from duralab.errors import InputError

_REAL_KINDS: Final = "iuf"
_IN_WORDS: Final = MappingProxyType({"c": "complex numbers", "b": "truth values", "U": "text", "S": "bytes"})


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
