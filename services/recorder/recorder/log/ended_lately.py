"""Recordings that ended lately: a step that is sent again is acknowledged without reading their files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from recorder.format import files_of
from recorder.log.step_order import StepOrder

REMEMBERED: Final = 50

_Files = tuple[tuple[str, int, int, int], ...]


class EndedLately:
    """The order of the steps of some recordings, as long as their files are those that were closed.

    Parameters
    ----------
    folder : Path
        Where the files are; who deletes, moves or changes one there takes away what was acknowledged of it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[StepOrder, _Files]] = {}

    def remember(self, name: str, order: StepOrder) -> None:
        """Note the steps of a recording whose last file is closed; the oldest is forgotten where there are many."""
        self._known[name] = (order, self._files(name))
        if len(self._known) > REMEMBERED:
            del self._known[next(iter(self._known))]

    def find(self, name: str) -> StepOrder | None:
        """Return the steps of a recording, or None where it is not known or its files are others now."""
        order, files = self._known.get(name, (None, ()))
        if order is not None and files != self._files(name):
            del self._known[name]
            return None
        return order

    def _files(self, name: str) -> _Files:
        found = [(path.name, path.stat()) for path in files_of(self._folder, name)]
        return tuple((file, status.st_ino, status.st_size, status.st_mtime_ns) for file, status in found)
