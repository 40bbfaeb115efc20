"""The figures of a campaign: one row for each playback, one column for each response channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from duralab_proto.v1 import iterator_pb2


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
    overall : np.ndarray, shape (playbacks)
        Root mean square over the channels of the relative RMS error.
    """

    channels: tuple[str, ...]
    numbers: tuple[int, ...]
    relative_rms_error: np.ndarray
    rms_response: np.ndarray
    peak_ratio: np.ndarray
    overall: np.ndarray

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

        return cls(
            channels=names,
            numbers=tuple(metrics.iteration for metrics in iterations),
            relative_rms_error=column("relative_rms_error"),
            rms_response=column("rms_response"),
            peak_ratio=column("peak_ratio"),
            overall=np.array([metrics.overall_relative_rms_error for metrics in iterations], dtype=np.float64),
        )

    def __len__(self) -> int:
        """Return how many playbacks there are."""
        return len(self.numbers)

    @property
    def best(self) -> int:
        """Row of the playback with the smallest error over all channels; the table must not be empty."""
        return int(np.argmin(self.overall))

    def __str__(self) -> str:
        """Return the table as text: relative RMS error (RMS response) for each playback and channel."""
        headings = ["playback", *(name.replace("_", " ") for name in self.channels), "overall"]
        rows = [[str(number), *self.cells(row), f"{self.overall[row]:.3f}"] for row, number in enumerate(self.numbers)]
        widths = [max(len(line[i]) for line in (headings, *rows)) for i in range(len(headings))]
        lines = [
            "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in (headings, *rows)
        ]
        return "\n".join(("relative RMS error (RMS response), 0 (1) is perfect", *lines))

    def cells(self, row: int) -> list[str]:
        """Return error and response of one playback for each channel, as text."""
        pairs = zip(self.relative_rms_error[row], self.rms_response[row], strict=True)
        return [f"{error:.3f} ({response:.2f})" for error, response in pairs]
