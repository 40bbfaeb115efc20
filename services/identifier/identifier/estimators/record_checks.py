"""Checks of channels during the record: dead, clipped, silent."""

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import NotFiniteError
from identifier.estimators.frf_estimate import ModelWarning, WarningCode

SHORTEST_FLAT_TOP = 3
"""Successive samples at one extreme value that may be clipped: noise is not constant, not even digitised."""

LARGEST_ROUNDED_OFF = 2.0
"""Largest excess over a flat top that rounding explains, in converter steps: a slow crest has up to 1."""

LONGEST_ROUNDED_OFF = 4.0
"""Length of a flat top over that of a crest within one step, for a sine of the channel's mean frequency."""

STEP_SAMPLES = 2**16
"""Number of a channel's samples that show its converter step: without one, two of them are hardly ever equal."""

# Samples per block, each of which is read several times: they fit into the second-level cache.
_LOOKED_AT_TOGETHER = 2**15

LARGEST_MAGNITUDE, SMALLEST_MAGNITUDE = 1e60, 1e-60
"""Range in which the squares of a density and their inverses are finite, for any quotient."""


class ChannelCheck:
    """Checks the channels of a record that arrives in pieces.

    `channels`: 1 or more. `name`: Name of a channel in a sentence: "drive" or "response". `of_drive`: Whether the
    warnings concern drives. `taken_off`: Shape (channels): offset subtracted from each channel before; sentences state
    the measured values. Zero if not given.
    """

    def __init__(
        self, channels: int, *, name: str, of_drive: bool, taken_off: NDArray[np.float64] | None = None
    ) -> None:
        self._name, self._of_drive = name, of_drive
        self._taken_off = np.zeros(channels) if taken_off is None else taken_off
        self._samples = 0
        self._steps = np.full(channels, np.inf)
        self._first, self._before = np.zeros(channels), np.zeros(channels)
        # Sums of the values, of their squares and of those of their changes.
        self._sums = np.zeros((channels, 3))
        self._looked_at = np.zeros(channels, dtype=np.int64)
        self._tops = _FlatTops(channels, sign=1.0)
        self._bottoms = _FlatTops(channels, sign=-1.0)

    def add(self, samples: NDArray[np.float64]) -> None:
        """Add the next used samples."""
        largest = np.zeros(samples.shape[0])
        for row, channel in enumerate(samples):
            parts = [
                channel[start : start + _LOOKED_AT_TOGETHER] for start in range(0, channel.size, _LOOKED_AT_TOGETHER)
            ]
            extremes = [(part.max(), -part.min()) for part in parts]
            highest, lowest = np.max(extremes, axis=0)
            if not (np.isfinite(highest) and np.isfinite(lowest)):
                raise NotFiniteError
            largest[row] = max(highest, lowest)
            self._tops.add(row, parts, [top for top, _ in extremes])
            self._bottoms.add(row, parts, [bottom for _, bottom in extremes])
        if np.any(largest > LARGEST_MAGNITUDE):
            row = int(np.argmax(largest))
            raise ValueError(
                f"{self._name.capitalize()} {row} reaches {largest[row]:g}; at most {LARGEST_MAGNITUDE:g} can be "
                "computed with, so check its sensor or take another unit."
            )
        for row, channel in enumerate(samples):
            self._find_step(row, channel)
        self._samples += samples.shape[1]

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Return the warnings about the record so far."""
        highest, lowest = self._tops.extreme + 0.0, -self._bottoms.extreme  # never a minus zero in a sentence
        dead = np.flatnonzero(highest - lowest < SMALLEST_MAGNITUDE)
        if dead.size:
            values = ", ".join(f"{self._name} {row} stays at {highest[row] + self._taken_off[row]:g}" for row in dead)
            raise ValueError(
                f"These channels are dead: {values}; "
                + ("excite every drive." if self._of_drive else "check their sensors or leave them out.")
            )
        # A channel that has not moved by then has no known step, so no step explains its flat tops.
        steps = np.where(np.isfinite(self._steps), self._steps, 0.0)
        rounded = self._longest_rounded(steps, peak=0.5 * (highest - lowest))
        flat = self._tops.clipped_samples(steps, rounded) + self._bottoms.clipped_samples(steps, rounded)
        return tuple(self._clipped(int(row), int(flat[row])) for row in np.flatnonzero(flat))

    def _find_step(self, row: int, channel: NDArray[np.float64]) -> None:
        """Store the smallest change of a channel from one sample to the next, and its mean rate of change."""
        part = channel[: max(0, STEP_SAMPLES - self._looked_at[row])]
        if part.size == 0:
            return
        if self._looked_at[row] == 0:
            self._first[row] = self._before[row] = part[0]
        changes = np.abs(np.diff(part, prepend=self._before[row]))
        self._steps[row] = min(self._steps[row], np.min(changes, where=changes > 0.0, initial=np.inf))
        moved = part - self._first[row]
        self._sums[row] += moved.sum(), moved @ moved, changes @ changes
        self._looked_at[row] += part.size
        self._before[row] = part[-1]

    def _longest_rounded(self, steps: NDArray[np.float64], *, peak: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the number of samples, shape (channels), that a crest may stay in one step without being clipped."""
        total, square, change = self._sums.T
        variation = square - total**2 / self._looked_at
        stay = np.divide(2.0 * steps * variation, peak * change, out=np.zeros_like(peak), where=change > 0.0)
        return 1.0 + LONGEST_ROUNDED_OFF * 2.0 * np.sqrt(stay)

    def _clipped(self, row: int, flat: int) -> ModelWarning:
        share = flat / self._samples
        lowest, highest = np.array([-self._bottoms.extreme[row], self._tops.extreme[row]]) + self._taken_off[row]
        return ModelWarning(
            WarningCode.CLIPPED,
            f"{self._name.capitalize()} {row} is clipped: {100.0 * share:.3g} % of its samples stand in flat tops at "
            f"{lowest:g} or {highest:g}; the FRF is distorted: widen its range or lower the level.",
            channel=row,
            of_drive=self._of_drive,
            size=share,
        )


class _FlatTops:
    """Largest value so far, and the samples in runs of three or more at it; of the negative if `sign` is -1.

    A slow crest stays in one step of a coarse converter for several samples without being clipped. The flanks show
    this: a parabola through a flat top of n samples that falls by d to the next sample has a crest d (n - 1)^2 / (4 n)
    above the flat top. Rounding explains one step of that, and one of d. If an amplifier saturates softly the flanks
    are round; then the length shows it.
    """

    def __init__(self, channels: int, *, sign: float) -> None:
        self._sign = sign
        self.extreme = np.full(channels, -np.inf)
        self._flat_samples = np.zeros(channels, dtype=np.int64)
        # The coarsest step with which some flat top would still be clipped.
        self._coarsest = np.zeros(channels)
        self._longest = np.zeros(channels, dtype=np.int64)
        # The run at the end of the record so far, the sample before it, and the last sample.
        self._run = np.zeros(channels, dtype=np.int64)
        self._before_run = np.full(channels, np.nan)
        self._last = np.full(channels, np.nan)

    def add(self, row: int, parts: list[NDArray[np.float64]], extremes: list[float]) -> None:
        """Add the next samples of a channel in parts; the largest of each times the sign is its extreme."""
        extreme = max(extremes)
        if extreme > self.extreme[row]:
            self.extreme[row], self._run[row] = extreme, 0
            self._flat_samples[row], self._longest[row], self._coarsest[row] = 0, 0, 0.0
        for part, of_part in zip(parts, extremes, strict=True):
            if self._run[row] and part[0] != self._sign * self.extreme[row]:
                self._end_run(row, part[:1])
            if of_part == self.extreme[row]:
                self._count(row, np.flatnonzero(part == self._sign * of_part), part)
            self._last[row] = part[-1]

    def clipped_samples(self, steps: NDArray[np.float64], rounded: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the number of samples in flat tops that neither steps nor lengths, shapes (channels), explain."""
        for row in np.flatnonzero(self._run):
            self._end_run(int(row), np.array([np.nan]))
        return np.where((self._coarsest > steps) | (self._longest > rounded), self._flat_samples, 0)

    def _end_run(self, row: int, after: NDArray[np.float64]) -> None:
        self._judge(row, self._run[row : row + 1], self._before_run[row : row + 1], after)
        self._run[row] = 0

    def _count(self, row: int, at_extreme: NDArray[np.intp], part: NDArray[np.float64]) -> None:
        """Add the runs of a piece, one or more, the first joined to the last run of the piece before."""
        breaks = np.flatnonzero(np.diff(at_extreme) > 1) + 1
        starts = at_extreme[np.concatenate(([0], breaks))]
        lengths = np.diff(np.concatenate(([0], breaks, [at_extreme.size])))
        stops = starts + lengths
        before = part[starts - 1]
        if starts[0] == 0:
            before[0] = self._before_run[row] if self._run[row] else self._last[row]
            lengths[0] += self._run[row]
        whole = stops < part.size
        self._judge(row, lengths[whole], before[whole], part[stops[whole]])
        self._run[row], self._before_run[row] = (0, np.nan) if whole[-1] else (lengths[-1], before[-1])

    def _judge(
        self, row: int, lengths: NDArray[np.int64], before: NDArray[np.float64], after: NDArray[np.float64]
    ) -> None:
        """Add complete runs and the samples on either side of them, NaN if there is none."""
        flat = lengths >= SHORTEST_FLAT_TOP
        if flat.any():
            self._flat_samples[row] += np.sum(lengths[flat])
            self._longest[row] = max(self._longest[row], np.max(lengths))
            fall = self.extreme[row] - np.fmin(self._sign * before[flat], self._sign * after[flat])
            steps = 1.0 + LARGEST_ROUNDED_OFF * 4.0 * lengths[flat] / (lengths[flat] - 1.0) ** 2
            self._coarsest[row] = np.fmax(self._coarsest[row], np.fmax.reduce(fall / steps))
