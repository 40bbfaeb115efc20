"""Renamed keys of a campaign file: the old ones are read, and a sentence names the new ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any, Final

from duralab_settings.values import SettingsError

RENAMED: Final = {
    "at_limits": "limit_policy",
    "confirm.playbacks": "confirmations",
    "stop.largest_iterations": "stop.iterations",
    "update.algorithm": "update.kind",
    "update.gain": "update.iteration_gain",
    "update.groups.*.gain": "update.groups.*.iteration_gain",
    "update.forgetting": "update.secant.forgetting",
    "update.prior_strength": "update.secant.prior_strength",
    "update.caution": "update.secant.caution",
    "update.regularisation": "update.secant.regularisation",
    "update.secant.each_line": "update.secant.whole_record",
}
"""Old path of a key and new one; `*` is a placeholder for a name that the user gives."""


def with_new_keys(content: dict[Any, Any], *, name: str = "") -> tuple[dict[Any, Any], tuple[str, ...]]:
    """Return a campaign file's content with the present keys.

    Parameters
    ----------
    content : dict
        Content as read, of a whole campaign or of a part; not changed.
    name : str
        Beginning of an error's sentence, e.g. "my.yaml: ".

    Returns
    -------
    content : dict
        Content with new keys only, as far as the old ones are known.
    remarks : tuple of str
        One sentence that names every old key and its new one; empty if there was no old key.

    Raises
    ------
    SettingsError
        If the old and the new key of one setting are given.
    """
    renamed = deepcopy(content)
    found: dict[str, str] = {}
    for pattern, replacement in RENAMED.items():
        for place, names in list(_places(renamed, pattern.split("."))):
            old, new = _filled(pattern, names), _filled(replacement, names)
            value = place.pop(pattern.rpartition(".")[2])
            *parents, last = new.split(".")
            target = _descend(renamed, parents)
            if target is None or last in target:
                raise SettingsError(f"{name}{old} and {new} are one setting; leave {old} out.", field=old)
            target[last] = value
            found[old] = new
    if "confirm.playbacks" in found and not renamed["confirm"]:
        del renamed["confirm"]
    return (renamed if found else content), _remarks(found, name=name)


def new_key(path: str) -> str:
    """Return the present name of a dotted key, which is the same unless it was renamed.

    Parameters
    ----------
    path : str
        Dotted key, e.g. "stop.iterations" or "update.gain.left_vertical".

    Returns
    -------
    str
        Present name, e.g. "update.iteration_gain.left_vertical".
    """
    parts = path.split(".")
    for pattern, replacement in RENAMED.items():
        wanted = pattern.split(".")
        if len(parts) >= len(wanted) and all(map(_stands_for, wanted, parts)):
            names = [part for part, want in zip(parts, wanted, strict=False) if want == "*"]
            return ".".join([_filled(replacement, names), *parts[len(wanted) :]])
    return path


def remarks_on(keys: Iterable[str]) -> tuple[str, ...]:
    """Return a sentence that names the old ones among some dotted keys and their new names.

    Parameters
    ----------
    keys : iterable of str
        Keys as written.

    Returns
    -------
    tuple of str
        One sentence, or an empty tuple.
    """
    return _remarks({key: new for key in keys if (new := new_key(key)) != key}, name="")


def _remarks(found: Mapping[str, str], *, name: str) -> tuple[str, ...]:
    pairs = ", ".join(f"{old} is {new} now" for old, new in found.items())
    return (f"{name}{pairs}; the old name is read, but use the new one.",) if found else ()


def old_names(place: Sequence[str]) -> dict[str, str]:
    """Return the old keys of a section and their present names."""
    names = {}
    for pattern, replacement in RENAMED.items():
        *parents, old = pattern.split(".")
        *new_parents, new = replacement.split(".")
        here = len(parents) == len(place) and all(map(_stands_for, parents, place))
        if here and parents == new_parents:
            names[old] = new
    return names


def _stands_for(wanted: str, part: str) -> bool:
    return wanted in ("*", part)


def _places(content: Any, parts: list[str]) -> Iterator[tuple[dict[Any, Any], list[str]]]:
    """Yield the mappings that hold a key, and the names that match `*`."""
    head, *rest = parts
    if not isinstance(content, dict):
        return
    if not rest:
        if head in content:
            yield content, []
    elif head == "*":
        for key, inner in content.items():
            for place, names in _places(inner, rest):
                yield place, [str(key), *names]
    else:
        yield from _places(content.get(head), rest)


def _descend(content: dict[Any, Any], keys: list[str]) -> dict[Any, Any] | None:
    """Return the mapping at a place, which is made if it is missing; None if the place holds another value."""
    for key in keys:
        content = content.setdefault(key, {})
        if not isinstance(content, dict):
            return None
    return content


def _filled(pattern: str, names: list[str]) -> str:
    for name in names:
        pattern = pattern.replace("*", name, 1)
    return pattern
