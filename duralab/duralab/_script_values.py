"""Values that a script hands in, checked for their type before anything is asked or moved."""

from __future__ import annotations

import os
from collections.abc import Callable
from numbers import Integral
from pathlib import Path
from typing import TypeVar

import numpy as np

from duralab.errors import InputError

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
