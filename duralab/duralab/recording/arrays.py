"""Signals of a recording as lazy xarray datasets, which read only the requested samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

import numpy as np
import xarray
from xarray.backends import BackendArray
from xarray.core import indexing

from duralab.data import BandNote, Channel, Signals, marked
from duralab.errors import InputError
from duralab.recording.files import SignalWindows
from duralab.recording.judged_windows import JudgedWindows

Windows = SignalWindows | JudgedWindows
"""Readers of samples."""


class Direction(Enum):
    """Direction of signals of a run: drive or response."""

    DRIVE = "drive"
    RESPONSE = "response"


def target_dataset(signals: Signals, channels: Sequence[Channel], note: BandNote) -> xarray.Dataset:
    """Return a target in the layout of `signal_dataset`: a variable for each channel over time."""
    variables = {
        channel.name: ("time", row.copy(), _attributes(channel))
        for channel, row in zip(channels, signals.samples, strict=True)
    }
    time = ("time", np.arange(signals.samples.shape[1]) / signals.sample_rate, {"units": "s"})
    return marked(xarray.Dataset(variables, coords={"time": time}, attrs={"sample_rate": signals.sample_rate}), note)


def _attributes(channel: Channel) -> dict[str, str | float]:
    return {
        "units": channel.unit,
        "long_name": channel.label or channel.title,
        "minimum": channel.minimum,
        "maximum": channel.maximum,
    }


class _LazySignal(BackendArray):
    """Lazy channel of runs of one length, shape (runs, samples), or of one run, shape (samples)."""

    def __init__(
        self, windows: Windows, runs: Sequence[str], *, direction: Direction, row: int, samples: int, flat: bool
    ) -> None:
        self._windows = windows
        self._runs = list(runs)
        self._direction = direction
        self._row = row
        self.shape = (samples,) if flat else (len(runs), samples)
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        """Read the samples of an xarray key into a new array, which the caller may change."""
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray:
        *of_runs, time = key
        chosen = self._runs[of_runs[0]] if of_runs else self._runs[0]
        if isinstance(chosen, str):
            # Copy, because the windows are cached: a change in place would change later reads.
            return self._samples(chosen, time).copy()
        if not chosen:
            wanted = range(self.shape[-1])[time]
            return np.zeros((0,) if isinstance(wanted, int) else (0, len(wanted)))
        return np.stack([self._samples(run, time) for run in chosen])

    def _samples(self, run: str, time: int | slice) -> np.ndarray:
        wanted = range(self.shape[-1])[time]
        if isinstance(wanted, int):
            return self._row_of(run, wanted, wanted + 1)[0]
        if not wanted:
            return np.zeros(0)
        samples = self._row_of(run, min(wanted[0], wanted[-1]), max(wanted[0], wanted[-1]) + 1)
        return samples[:: wanted.step]

    def _row_of(self, run: str, first: int, last: int) -> np.ndarray:
        window = self._windows.read(run, first, last)
        return (window.drive if self._direction is Direction.DRIVE else window.response)[self._row]


def signal_dataset(
    windows: Windows,
    channels: Sequence[Channel],
    runs: Sequence[str],
    *,
    direction: Direction,
    iterations: Mapping[str, int],
    levels: Mapping[str, float],
    flat: bool,
    note: BandNote | None = None,
) -> xarray.Dataset:
    """Return the drives or the responses of runs, one lazily read variable for each channel."""
    sizes = {run: windows.size(run) for run in runs}
    if len(set(sizes.values())) > 1:
        lengths = ", ".join(f"{run} {samples / rate:g} s" for run, (samples, rate) in sizes.items())
        raise InputError(f"The runs differ in length or sample rate ({lengths}); ask for those of one length together.")
    if not sizes:
        raise InputError("No run is asked for and none is recorded; give the name of a run of `runs`.")
    samples, rate = next(iter(sizes.values()))
    dims = ("time",) if flat else ("run", "time")
    numbers = [iterations.get(run, 0) for run in runs]
    shares = [levels.get(run, np.nan) for run in runs]
    variables = {
        channel.name: xarray.Variable(
            dims,
            # Allows assignment to samples before they are read.
            indexing.CopyOnWriteArray(
                indexing.LazilyIndexedArray(  # pyright: ignore[reportArgumentType]
                    _LazySignal(windows, runs, direction=direction, row=row, samples=samples, flat=flat)
                )
            ),
            _attributes(channel),
        )
        for row, channel in enumerate(channels)
    }
    dataset = xarray.Dataset(
        variables,
        coords={
            "time": ("time", np.arange(samples) / rate, {"units": "s"}),
            "run": runs[0] if flat else ("run", list(runs)),
            "iteration": numbers[0] if flat else ("run", numbers),
            "level": shares[0] if flat else ("run", shares),
        },
        attrs={"sample_rate": rate, "direction": direction.value},
    )
    return dataset if note is None else marked(dataset, note)
