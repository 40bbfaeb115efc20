"""Dotted keys: a place in a YAML document, e.g. `update.iteration_gain` or `struts.left_strut.law.stiffness`."""

from __future__ import annotations

from typing import Any

from duralab.errors import InputError

NAME = "name"
"""What an entry of a list is found by."""


def change(document: dict[str, Any], key: str, value: Any, *, what: str, add: bool = True) -> None:
    """Put a value in its place."""
    parents, last = _parts(key, what=what)
    place: Any = document
    for depth, part in enumerate(parents):
        if add and isinstance(place, dict) and place.get(part) is None:
            place[part] = {}
        place = _step(place, part, key=key, depth=depth, what=what)
    if isinstance(place, dict) and add:
        place[last] = value
        return
    _step(place, last, key=key, depth=len(parents), what=what)
    place[last if isinstance(place, dict) else _index(place, last)] = value


def look_up(document: dict[str, Any], key: str, *, what: str) -> Any:
    """Return what stands at a place; raises InputError where nothing does."""
    parents, last = _parts(key, what=what)
    place: Any = document
    for depth, part in enumerate([*parents, last]):
        place = _step(place, part, key=key, depth=depth, what=what)
    return place


def _parts(key: str, *, what: str) -> tuple[list[str], str]:
    *parents, last = key.split(".")
    if not all((*parents, last)):
        raise InputError(f"The key {key!r} of {what} has an empty part; write e.g. 'update.iteration_gain'.", field=key)
    return parents, last


def _step(place: Any, part: str, *, key: str, depth: int, what: str) -> Any:
    if isinstance(place, dict) and part in place:
        return place[part]
    if isinstance(place, list) and (index := _index(place, part)) >= 0:
        return place[index]
    there = ".".join(key.split(".")[:depth]) or "the top"
    raise InputError(f"The key {key!r} leads nowhere in {what}: at {there}, there is {_told(place)}.", field=key)


def _index(entries: list[Any], part: str) -> int:
    """Return the row of a list's entry by its name or its number; -1 where there is none."""
    for row, entry in enumerate(entries):
        if isinstance(entry, dict) and entry.get(NAME) == part:
            return row
    return int(part) if part.isdecimal() and int(part) < len(entries) else -1


def _told(place: Any) -> str:
    if isinstance(place, dict):
        return ", ".join(map(str, place)) or "nothing"
    if isinstance(place, list):
        names = [str(entry.get(NAME, row)) if isinstance(entry, dict) else str(row) for row, entry in enumerate(place)]
        return ", ".join(names) or "an empty list"
    return f"the value {place!r}, which has no parts"
