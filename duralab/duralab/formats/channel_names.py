"""Names of channels as files have them, made fit to be told apart."""

from __future__ import annotations

from collections.abc import Iterable


def unique_names(names: Iterable[str]) -> list[str]:
    """Return the names, each once, in order.

    An empty one becomes "channel_<place>", from 1; one that stood before gets "_2", "_3" and so on.
    """
    taken: set[str] = set()
    unique: list[str] = []
    for place, given in enumerate(names, start=1):
        base = given.strip() or f"channel_{place}"
        name, count = base, 1
        while name in taken:
            count += 1
            name = f"{base}_{count}"
        taken.add(name)
        unique.append(name)
    return unique
