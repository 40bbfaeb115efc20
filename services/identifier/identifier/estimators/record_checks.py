"""Channels that say nothing or not the truth: dead, clipped, silent; checked while the record passes."""

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from spectra import NotFiniteError

SHORTEST_FLAT_TOP = 3
"""Samples in a row at one extreme value that count as clipped: noise does not stand still, not even digitised."""


# Each is looked at several times: so many stay in the second cache.
_LOOKED_AT_TOGETHER = 2**15

LARGEST_MAGNITUDE, SMALLEST_MAGNITUDE = 1e60, 1e-60
"""Between these the squares of a density and their inverses are finite numbers, whatever is divided by whatever."""


class ChannelCheck:
    """Watches the channels of a record that arrives in pieces.

    Parameters
    ----------
    channels
        1 or more.
    name
        What a channel is called in a sentence: "drive" or "response".
    of_drive
        Whether the warnings concern drives.
    taken_off
        Shape (channels): what was taken off each channel before; sentences tell the values that were measured. Nothing
        where not given.
    """

    def __init__(
        self, channels: int, *, name: str, of_drive: bool, taken_off: NDArray[np.float64] | None = None
    ) -> None:
        self._name, self._of_drive = name, of_drive
        self._taken_off = np.zeros(channels) if taken_off is None else taken_off
        self._samples = 0
        self._tops = _FlatTops(channels, sign=1.0)
        self._bottoms = _FlatTops(channels, sign=-1.0)

    def add(self, samples: NDArray[np.float64]) -> None:
        """Watch the next samples that are used.

        Parameters
        ----------
        samples
            Shape (channels, samples), a record.

        Raises
        ------
        NotFiniteError
            Where a value is not finite: which one, `spectra.as_record` says.
        ValueError
            Where a magnitude is beyond what can be computed with.
        """
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
        self._samples += samples.shape[1]

    def warnings(self) -> tuple[ModelWarning, ...]:
        """Judge the record so far.

        Returns
        -------
        tuple of ModelWarning
            One for each clipped channel.

        Raises
        ------
        ValueError
            Where channels never move; all of them are named.
        """
        highest, lowest = self._tops.extreme + 0.0, -self._bottoms.extreme  # never a minus zero in a sentence
        dead = np.flatnonzero(highest - lowest < SMALLEST_MAGNITUDE)
        if dead.size:
            values = ", ".join(f"{self._name} {row} stays at {highest[row] + self._taken_off[row]:g}" for row in dead)
            raise ValueError(
                f"These channels are dead: {values}; "
                + ("excite every drive." if self._of_drive else "check their sensors or leave them out.")
            )
        flat = self._tops.flat_samples + self._bottoms.flat_samples
        return tuple(self._clipped(int(row), int(flat[row])) for row in np.flatnonzero(flat))

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
    """Largest value so far, and the samples of runs of three and more at it; of the negative where `sign` is -1."""

    def __init__(self, channels: int, *, sign: float) -> None:
        self._sign = sign
        self.extreme = np.full(channels, -np.inf)
        self.flat_samples = np.zeros(channels, dtype=np.int64)
        self._run = np.zeros(channels, dtype=np.int64)

    def add(self, row: int, parts: list[NDArray[np.float64]], extremes: list[float]) -> None:
        """Take the next samples of a channel in parts; the largest of each times the sign is its extreme."""
        extreme = max(extremes)
        if extreme > self.extreme[row]:
            self.extreme[row], self.flat_samples[row], self._run[row] = extreme, 0, 0
        for part, of_part in zip(parts, extremes, strict=True):
            if of_part < self.extreme[row]:
                self._run[row] = 0
            else:
                self._count(row, np.flatnonzero(part == self._sign * of_part), part.size)

    def _count(self, row: int, at_extreme: NDArray[np.intp], size: int) -> None:
        """Add the runs of a piece, one or more, the first joined to the one that the piece before ended with."""
        breaks = np.flatnonzero(np.diff(at_extreme) > 1) + 1
        starts = at_extreme[np.concatenate(([0], breaks))]
        lengths = np.diff(np.concatenate(([0], breaks, [at_extreme.size])))
        if starts[0] == 0 and self._run[row]:
            joined = self._run[row] + lengths[0]
            counted = self._run[row] if self._run[row] >= SHORTEST_FLAT_TOP else 0
            self.flat_samples[row] += joined - counted if joined >= SHORTEST_FLAT_TOP else 0
            run_before, lengths, starts = joined, lengths[1:], starts[1:]
        else:
            run_before = 0
        self.flat_samples[row] += int(np.sum(lengths[lengths >= SHORTEST_FLAT_TOP]))
        reaches_end = at_extreme[-1] == size - 1
        self._run[row] = 0 if not reaches_end else int(lengths[-1]) if lengths.size else int(run_before)
