"""Responses that stand still while drives move: a stuck sensor makes the FRF smaller and is not detected elsewhere."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.layout import Layout, Window

FEWEST_SAMPLES = 16
"""A shorter standstill may be the crest of a slow signal on a coarse converter."""


class _Run(NamedTuple):
    """Samples of one response with one value; `moved` of them while a drive moved."""

    row: int
    start: int
    stop: int
    moved: int
    value: float


class StandstillCheck:
    """Checks the responses of a record that arrives in pieces for values that repeat while drives move.

    A response stands still if it keeps exactly one value for a period of the lowest excited frequency; for a block if
    not every frequency is present at every instant, as in a sweep, whose ends a coarse converter may not resolve. Only
    samples with a moving drive count: a rig comes to rest between bursts.

    `layout`: Layout of the record. `responses`: Number of channels, 1 or more. `taken_off`: Shape (responses): offset
    subtracted from each channel before; sentences state the measured values. Zero if not given.
    """

    def __init__(self, layout: Layout, *, responses: int, taken_off: NDArray[np.float64] | None = None) -> None:
        self._rate = layout.sample_rate
        self._taken_off = np.zeros(responses) if taken_off is None else taken_off
        always_there = layout.periodic or layout.window is Window.HANN
        lowest_line = int(np.argmax(layout.excited[1:])) + 1 if always_there else 1
        self._shortest = max(-(-layout.block_samples // lowest_line), FEWEST_SAMPLES)
        self._samples = self._stop = 0
        self._drive_before: NDArray[np.float64] | None = None
        self._value = np.full(responses, np.nan)
        # First sample of the present run of each response, and its number of samples with a moving drive.
        self._start = np.zeros(responses, dtype=np.int64)
        self._moved = np.zeros(responses, dtype=np.int64)
        self._found: list[_Run] = []

    def add(self, drive: NDArray[np.float64], response: NDArray[np.float64], *, first: int) -> None:
        """Add the next used samples."""
        moving = self._moving(drive)
        self._samples += int(np.count_nonzero(moving))
        # A counted run holds two neighbours on this grid: if no two are equal only the ends matter.
        step = self._shortest // 2
        for row, samples in enumerate(response):
            grid = samples[::step]
            if samples.size <= 4 * step or np.any(grid[1:] == grid[:-1]):
                self._follow(row, samples, moving, first)
                continue
            self._follow(row, samples[: 2 * step], moving, first)
            self._value[row], self._moved[row] = np.nan, 0
            rest = samples.size - 2 * step
            self._follow(row, samples[rest:], moving[rest:], first + rest)
        self._drive_before = drive[:, -1].copy()

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Return the warnings about the record so far."""
        rows = range(self._value.size)
        running = [self._run(row, stop=self._stop, moved=int(self._moved[row])) for row in rows]
        found = [*self._found, *(run for run in running if run.moved >= self._shortest)]
        return tuple(
            self._warning([run for run in found if run.row == row]) for row in sorted({run.row for run in found})
        )

    def _moving(self, drive: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether any drive differs from its sample before."""
        moving = np.zeros(drive.shape[1], dtype=bool)
        moving[0] = self._drive_before is not None and bool(np.any(drive[:, 0] != self._drive_before))
        for channel in drive:
            moving[1:] |= channel[1:] != channel[:-1]
            if moving[1:].all():
                break
        return moving

    def _follow(self, row: int, samples: NDArray[np.float64], moving: NDArray[np.bool_], first: int) -> None:
        """Continue the present run of a response over the next samples."""
        self._stop = first + samples.size
        changes = np.flatnonzero(samples[1:] != samples[:-1]) + 1
        if samples[0] != self._value[row]:
            changes = np.concatenate(([0], changes))
        if changes.size == 0:
            self._moved[row] += np.count_nonzero(moving[: samples.size])
            return
        moved = int(self._moved[row]) + int(np.count_nonzero(moving[: changes[0]]))
        self._judge(self._run(row, stop=first + int(changes[0]), moved=moved))
        for index in np.flatnonzero(np.diff(changes) >= self._shortest):
            start, stop = int(changes[index]), int(changes[index + 1])
            moved = int(np.count_nonzero(moving[start:stop]))
            self._judge(_Run(row, first + start, first + stop, moved, float(samples[start])))
        last = int(changes[-1])
        self._start[row], self._value[row] = first + last, samples[last]
        self._moved[row] = np.count_nonzero(moving[last : samples.size])

    def _run(self, row: int, *, stop: int, moved: int) -> _Run:
        return _Run(row, int(self._start[row]), stop, moved, float(self._value[row]))

    def _judge(self, run: _Run) -> None:
        if run.moved >= self._shortest:
            self._found.append(run)

    def _warning(self, runs: list[_Run]) -> ModelWarning:
        row, start, stop, _, value = max(runs, key=lambda run: run.moved)
        share = sum(run.moved for run in runs) / self._samples
        return ModelWarning(
            WarningCode.STUCK,
            f"Response {row} stands still at {value + self._taken_off[row]:g} from {start / self._rate:.4g} s to "
            f"{stop / self._rate:.4g} s while drives move, {100.0 * share:.3g} % of that time in all; its FRF is too "
            "small: check its sensor and its range, and play the experiment again.",
            channel=row,
            size=share,
        )
