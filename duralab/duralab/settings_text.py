"""Text of settings that a user wrote: from a YAML file to a mapping, or one sentence that says what is wrong."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from duralab._near_files import did_you_mean
from duralab.errors import InputError
from strict_yaml import YamlError, parse_yaml, read_yaml_text


def read_text(path: Path, *, what: str) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it should be, e.g. "a campaign".

    Raises
    ------
    InputError
        It cannot be read, is no regular file, is larger than a YAML file may be, or is no text in UTF-8.
    """
    try:
        return read_yaml_text(path)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file in UTF-8 (byte {error.start}); {what} is YAML text.") from error
    except FileNotFoundError as error:
        raise InputError(f"There is no file {str(path)!r}; give the path of {what}{did_you_mean(path)}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error


def parse_mapping(text: str, *, name: str, what: str, keys: Iterable[str]) -> dict[Any, Any]:
    """Return the mapping that a YAML text holds.

    Parameters
    ----------
    text : str
        The text.
    name : str
        Of the file, for an error.
    what : str
        What it should be, e.g. "a campaign file".
    keys : iterable of str
        What it may hold, for an error.

    Raises
    ------
    InputError
        It is no YAML, holds a key twice, or no mapping.
    """
    try:
        content = parse_yaml(text)
    except YamlError as error:
        raise InputError(f"{name} is not YAML: {error}.") from error
    if not isinstance(content, dict):
        found = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise InputError(f"{name} {found}; {what} holds the keys {', '.join(keys)}.")
    return content
