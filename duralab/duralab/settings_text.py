"""Text of settings that a user wrote: from a YAML file to a mapping, or one sentence that says what is wrong."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from duralab.errors import InputError


class _StrictLoader(yaml.SafeLoader):
    """YAML in which a key stands once: the second of two equal keys would silently win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node, refusing a key that stands twice."""
        seen: set[str] = set()
        for key, _ in node.value:
            name = str(key.value)
            if name in seen:
                line = key.start_mark.line + 1
                raise yaml.MarkedYAMLError(
                    problem=f"the key {name!r} of line {line} stands there already", problem_mark=key.start_mark
                )
            seen.add(name)
        return super().construct_mapping(node, deep=deep)


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
        It cannot be read, or is no text in UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file in UTF-8 (byte {error.start}); {what} is YAML text.") from error
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
        content = yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise InputError(f"{name} is not valid YAML{place}: {error.problem}.") from error
    except yaml.YAMLError as error:
        raise InputError(f"{name} is not valid YAML: {' '.join(str(error).split())}.") from error
    if not isinstance(content, dict):
        found = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise InputError(f"{name} {found}; {what} holds the keys {', '.join(keys)}.")
    return content
