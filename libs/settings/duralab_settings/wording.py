"""Errors of settings, in one sentence: the key, the value, the allowed values."""

from __future__ import annotations

from pydantic import BaseModel, ValidationError

from duralab_settings.old_keys import old_names
from duralab_settings.validation import explain_validation
from duralab_settings.values import ONE_NUMBER, PER_CHANNEL, SettingsError


def explained(
    error: ValidationError,
    root: type[BaseModel],
    *,
    name: str = "",
    place: tuple[str, ...] = (),
    prefix: str = "",
    is_part: bool = False,
) -> SettingsError:
    """Return the error of settings in one sentence.

    Parameters
    ----------
    error : ValidationError
        Error of pydantic.
    root : type
        Model that holds all keys.
    name : str
        Beginning of the sentence, e.g. the name of a file.
    place : tuple of str
        Keys of the root that lead to the checked part.
    prefix : str
        Path of the root itself, e.g. "excitation"; empty if it is the whole.
    is_part : bool
        Whether keys of the part itself may be missing.

    Returns
    -------
    SettingsError
        Error with the path of the first wrong key.
    """
    hidden = (ONE_NUMBER, PER_CHANNEL)
    found = explain_validation(
        error, root, place=place, prefix=prefix, hidden=hidden, is_part=is_part, joint=" ", older=old_names
    )
    return SettingsError(f"{name}{found.sentence}", field=found.field)
