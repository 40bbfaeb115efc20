"""Repeats recorded with all samples: the first, every n-th, and those around an alarm."""

from __future__ import annotations

import zipfile
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from duralab_schedules import KeepRule


@dataclass(frozen=True, eq=False)
class HeldRepeat:
    """A repeat whose signal blocks are not kept, with its response, shape (responses, samples)."""

    repeat: int
    event: int
    drive: int
    run: str
    response: NDArray[np.float64]


class HeldFiles:
    """Held repeats of one endurance test on disk, one file each, so that a crash of the sequencer does not lose them.

    `folder`: Private folder of this test. `warn`: Called with a sentence if the disk fails. A file is whole or absent
    after a crash of the process; it is not synchronised, so a loss of power may lose the last ones.
    """

    def __init__(self, folder: Path, *, warn: Callable[[str], object]) -> None:
        self._folder = folder
        self._warn = warn

    def read(self) -> list[HeldRepeat]:
        """Return the repeats in order; an unreadable one is logged and left out."""
        found = []
        for path in sorted(self._folder.glob("*.npz")):
            try:
                with np.load(path, allow_pickle=False) as stored:
                    repeat, event, drive = (int(number) for number in stored["numbers"])
                    found.append(HeldRepeat(repeat, event, drive, str(stored["run"]), stored["response"]))
            except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
                self._warn(f"The held repeat {path.name} cannot be read, its samples are lost: {error}.")
        return found

    def write(self, held: HeldRepeat) -> None:
        """Store a repeat; if the disk refuses it, it is held in memory only."""
        path = self._path(held)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with path.with_suffix(".part").open("wb") as stream:
                numbers = np.array([held.repeat, held.event, held.drive])
                np.savez(stream, numbers=numbers, run=np.array(held.run), response=held.response)
            path.with_suffix(".part").replace(path)
        except OSError as error:
            self._warn(f"Repeat {held.repeat} is held in memory only: {error.strerror or error}.")

    def remove(self, held: HeldRepeat) -> None:
        """Remove the file of a repeat."""
        with suppress(OSError):
            self._path(held).unlink()

    def close(self) -> None:
        """Remove the folder of a test that has ended."""
        with suppress(OSError):
            for path in self._folder.iterdir():
                path.unlink()
            self._folder.rmdir()

    def _path(self, held: HeldRepeat) -> Path:
        return self._folder / f"{held.repeat:09d}.npz"


class KeptSamples:
    """The rule of a schedule, and the last responses in case an alarm requires them.

    `rule`: Rule of the schedule. `kept_before`: Repeats before this one are kept because of an alarm. `files`: Files of
    the held repeats, if any.
    """

    def __init__(self, rule: KeepRule, *, kept_before: int = 0, files: HeldFiles | None = None) -> None:
        self._rule = rule
        self._files = files
        self.kept_before = kept_before
        self._held: deque[HeldRepeat] = deque(maxlen=rule.around_alarm + 1)

    def keeps(self, repeat: int, nth: int) -> bool:
        """Return whether the signal blocks of a repeat are kept; it is the `nth` of its event, from 0."""
        return repeat < self.kept_before or self._rule.keeps(nth)

    def restore(self, *, next_repeat: int, stored: set[int]) -> list[HeldRepeat]:
        """Hold the repeats that a crash left; return those required by an alarm and not `stored` before it."""
        left = [] if self._files is None else self._files.read()
        owed = [held for held in left if held.repeat < self.kept_before and held.repeat not in stored]
        for held in left:
            if held.repeat in stored or held.repeat >= next_repeat:
                self.forget(held)
            elif held.repeat >= self.kept_before:
                self._held.append(held)
        return [held for held in owed if held.repeat < next_repeat]

    def hold(self, held: HeldRepeat) -> None:
        """Hold a played repeat until as many later ones are held as an alarm may require."""
        if len(self._held) == self._held.maxlen:
            self.forget(self._held[0])
        self._held.append(held)
        if self._files is not None:
            self._files.write(held)

    def after_alarm(self, repeat: int) -> list[HeldRepeat]:
        """Return the held repeats around an alarm, and keep as many after it; each is returned once."""
        self.kept_before = max(self.kept_before, repeat + self._rule.around_alarm + 1)
        held = [each for each in self._held if each.repeat >= repeat - self._rule.around_alarm]
        for each in self._held:
            if each not in held:
                self.forget(each)
        self._held.clear()
        return held

    def forget(self, held: HeldRepeat) -> None:
        """Remove the file of a repeat that is recorded, or that no alarm can require any more."""
        if self._files is not None:
            self._files.remove(held)

    def close(self) -> None:
        """Remove all files at the end of the test."""
        if self._files is not None:
            self._files.close()
