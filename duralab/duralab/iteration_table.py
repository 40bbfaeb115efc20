"""The figures of a campaign: one row for each playback, one column for each response channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab_proto.v1 import iterator_pb2

if TYPE_CHECKING:
    import xarray

DAMAGE_SLOPES: Final = (3, 5, 8)
"""Slopes of the S-N lines that damage ratios are told for, as the contract orders them."""


@dataclass(frozen=True, eq=False)
class IterationTable:
    """Figures of every playback, in the control band.

    Parameters
    ----------
    channels : tuple of str
        Names of the responses, in the rig's order.
    numbers : tuple of int
        Number of each playback, from 1.
    relative_rms_error : np.ndarray, shape (playbacks, channels)
        rms(target - response) / rms(target).
    rms_response : np.ndarray, shape (playbacks, channels)
        rms(response) / rms(target).
    peak_ratio : np.ndarray, shape (playbacks, channels)
        Largest magnitude of the response over that of the target.
    damage_ratio : np.ndarray, shape (playbacks, channels, 3)
        Pseudo-damage of the response over that of the target, for S-N lines of slope 3, 5 and 8; not a number where an
        older recording does not tell it.
    overall : np.ndarray, shape (playbacks)
        Root mean square over the judged channels of the relative RMS error.
    level : np.ndarray, shape (playbacks)
        Share of the target that was played for, which all figures are relative to; 1 is the whole.
    watched : np.ndarray of bool, shape (channels)
        True for a channel that is told, but neither controlled nor judged; its figures are not a number where its
        target is silent.
    """

    channels: tuple[str, ...]
    numbers: tuple[int, ...]
    relative_rms_error: np.ndarray
    rms_response: np.ndarray
    peak_ratio: np.ndarray
    damage_ratio: np.ndarray
    overall: np.ndarray
    level: np.ndarray
    watched: np.ndarray

    @classmethod
    def from_messages(cls, iterations: Sequence[iterator_pb2.IterationMetrics]) -> IterationTable:
        """Decode the metrics of a campaign; an empty sequence gives an empty table."""
        names = tuple(channel.channel for channel in iterations[0].channels) if iterations else ()
        for metrics in iterations:
            if tuple(channel.channel for channel in metrics.channels) != names:
                raise ValueError(f"Playback {metrics.iteration} has other channels than the first, {', '.join(names)}.")

        def column(name: str) -> np.ndarray:
            rows = [[getattr(channel, name) for channel in metrics.channels] for metrics in iterations]
            return np.array(rows, dtype=np.float64).reshape(len(iterations), len(names))

        damage = np.full((len(iterations), len(names), len(DAMAGE_SLOPES)), np.nan)
        for row, metrics in enumerate(iterations):
            for i, channel in enumerate(metrics.channels):
                if len(channel.damage_ratio) == len(DAMAGE_SLOPES):
                    damage[row, i] = channel.damage_ratio
        return cls(
            channels=names,
            numbers=tuple(metrics.iteration for metrics in iterations),
            relative_rms_error=column("relative_rms_error"),
            rms_response=column("rms_response"),
            peak_ratio=column("peak_ratio"),
            damage_ratio=damage,
            overall=np.array([metrics.overall_relative_rms_error for metrics in iterations], dtype=np.float64),
            # Recordings from before there were levels hold 0.
            level=np.array([metrics.level or 1.0 for metrics in iterations], dtype=np.float64),
            # As the last playback was judged: one that was taken over may have been judged otherwise.
            watched=np.array(
                [channel.watched for channel in iterations[-1].channels] if iterations else [], dtype=bool
            ),
        )

    def __len__(self) -> int:
        """Return how many playbacks there are."""
        return len(self.numbers)

    @property
    def judged_error(self) -> np.ndarray:
        """Relative RMS error of the channels that are judged, shape (playbacks, judged)."""
        return self.relative_rms_error[:, ~self.watched]

    @property
    def judged(self) -> tuple[str, ...]:
        """Names of the channels that are judged: all but the watched ones."""
        return tuple(name for name, watched in zip(self.channels, self.watched, strict=True) if not watched)

    @property
    def best(self) -> int:
        """Row of the playback of the whole target with the smallest error over all channels; there must be a playback.

        Where none was of the whole target yet, it is the best of those at a part of it.
        """
        whole = self.level == 1.0
        return int(np.argmin(np.where(whole, self.overall, np.inf) if whole.any() else self.overall))

    def to_xarray(self) -> xarray.Dataset:
        """Return the figures over `iteration`, `channel` and `slope` (of the S-N line), ratios all."""
        import xarray

        return xarray.Dataset(
            {
                "relative_rms_error": (("iteration", "channel"), self.relative_rms_error, {"units": "1"}),
                "rms_response": (("iteration", "channel"), self.rms_response, {"units": "1"}),
                "peak_ratio": (("iteration", "channel"), self.peak_ratio, {"units": "1"}),
                "damage_ratio": (("iteration", "channel", "slope"), self.damage_ratio, {"units": "1"}),
                "overall": (("iteration",), self.overall, {"units": "1"}),
                "level": (("iteration",), self.level, {"units": "1"}),
            },
            coords={"iteration": list(self.numbers), "channel": list(self.channels), "slope": list(DAMAGE_SLOPES)},
        )

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"IterationTable({len(self)} playbacks, {len(self.channels)} channels)"

    def __str__(self) -> str:
        """Return the table as text: relative RMS error (RMS response) for each playback and channel."""
        from duralab.showing.campaigns import iterations_text

        return iterations_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.campaigns import iterations_html

        return iterations_html(self)

    def cells(self, row: int) -> list[str]:
        """Return error and response of one playback for each channel, as text.

        Parameters
        ----------
        row : int
            Of the table, from 0.

        Returns
        -------
        list of str
            One for each channel.
        """
        pairs = zip(self.relative_rms_error[row], self.rms_response[row], strict=True)
        return ["–" if np.isnan(error) else f"{error:.3f} ({response:.2f})" for error, response in pairs]
