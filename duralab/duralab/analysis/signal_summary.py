"""Summary of sampled signals: range, RMS, band of their energy and a coarse power spectral density."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab.data import Signals
from duralab_spectra import auto_spectra, line_frequencies

ENERGY_SHARE: Final = 0.99
"""Share of a channel's energy inside its band."""

COLUMNS: Final = 32
"""Number of bands of the coarse density, equally wide on a logarithmic frequency axis."""

_AVERAGED_PARTS: Final = 4
"""A block of the density is about a quarter of the record: with half overlap this gives at least seven averages."""
_LARGEST_BLOCK: Final = 2**16
_SHORTEST_BLOCK: Final = 16
_LARGEST: Final = 1e150
"""Largest magnitude of a channel with a density; the density of larger values may overflow."""


@dataclass(frozen=True, eq=False)
class ChannelSummary:
    """Summary of one channel, in its unit.

    `name`, `unit`: Name and unit of the channel. `not_finite`: Number of samples that are NaN or infinite; the other
    values do not include them. `minimum`, `maximum`, `mean`, `rms`: Values of all finite samples; NaN without any.
    `band`: Frequencies in Hz below and above which 0.5 % of the energy is, without the mean; None if the channel is
    constant, not finite, larger than 1e150, or shorter than 16 samples. `psd`, shape (columns) or (0): Largest power
    spectral density of each frequency band, one-sided, in the unit squared per Hz; empty if `band` is None.
    """

    name: str
    unit: str
    not_finite: int
    minimum: float
    maximum: float
    mean: float
    rms: float
    band: tuple[float, float] | None
    psd: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SignalSummary:
    """Summary of signals.

    `sample_rate`: Sample rate in Hz. `samples`: Number of samples of each channel. `duration`: Duration in s.
    `resolution`: Distance of two lines of the density, in Hz; NaN if the signals are too short. `psd_edges`, shape
    (columns + 1) or (0): Edges of the frequency bands of `ChannelSummary.psd`, in Hz. `channels`: Summaries in the
    order of the signals.
    """

    sample_rate: float
    samples: int
    duration: float
    resolution: float
    psd_edges: NDArray[np.float64]
    channels: tuple[ChannelSummary, ...]


def summarize(signals: Signals) -> SignalSummary:
    """Summarize signals.

    `signals`: Signals of any length; samples that are not finite are counted.
    Returns: Summary with densities by Welch's method: periodic Hann window, half overlap, mean of the record removed.
    """
    count = signals.samples.shape[1]
    block, edges, lines = 0, np.empty(0), np.empty(0)
    if count >= _SHORTEST_BLOCK:
        block = min(_LARGEST_BLOCK, max(_SHORTEST_BLOCK, 2 ** int(np.log2(count / _AVERAGED_PARTS))))
        # The line at 0 Hz contains the rest of the mean.
        lines = line_frequencies(block, signals.sample_rate)[1:]
        edges = np.geomspace(lines[0], lines[-1], COLUMNS + 1)
    channels = []
    # Sums over a long channel of the largest values may overflow; it has no band then.
    with np.errstate(over="ignore", invalid="ignore"):
        for channel, row in zip(signals.channels, signals.samples, strict=True):
            minimum, maximum, mean, rms = _figures(row[np.isfinite(row)])
            band, psd = None, np.empty(0)
            if block and np.isfinite(row).all() and -_LARGEST < minimum < maximum < _LARGEST:
                density = _density(row, block=block, sample_rate=signals.sample_rate)
                if 0.0 < density.sum() < np.inf:
                    band, psd = _band(lines, density), _coarse(lines, density, edges)
            not_finite = int(np.count_nonzero(~np.isfinite(row)))
            channels.append(
                ChannelSummary(channel.name, channel.unit, not_finite, minimum, maximum, mean, rms, band=band, psd=psd)
            )
    return SignalSummary(
        sample_rate=signals.sample_rate,
        samples=count,
        duration=signals.duration,
        resolution=float(lines[0]) if block else np.nan,
        psd_edges=edges,
        channels=tuple(channels),
    )


def _figures(finite: NDArray[np.float64]) -> tuple[float, float, float, float]:
    if not finite.size:
        return np.nan, np.nan, np.nan, np.nan
    minimum, maximum = float(finite.min()), float(finite.max())
    # The square of a value from a damaged file may overflow; a power of two as the scale changes no digit.
    _, exponent = np.frexp(max(-minimum, maximum))
    scaled = np.ldexp(finite, -exponent)
    mean, rms = np.ldexp([scaled.mean(), np.sqrt(np.mean(scaled**2))], exponent)
    return minimum, maximum, float(mean), float(rms)


def _density(row: NDArray[np.float64], *, block: int, sample_rate: float) -> NDArray[np.float64]:
    dynamic = (row - row.mean())[None]
    return auto_spectra(dynamic, block_samples=block, overlap=0.5, sample_rate=sample_rate)[1:, 0]


def _band(lines: NDArray[np.float64], density: NDArray[np.float64]) -> tuple[float, float]:
    """Return the frequencies that enclose `ENERGY_SHARE` of the energy, with half of the rest on either side."""
    energy = np.cumsum(density)
    outside = (1.0 - ENERGY_SHARE) / 2.0
    low, high = np.searchsorted(energy, np.array([outside, 1.0 - outside]) * energy[-1])
    return float(lines[low]), float(lines[min(high, lines.size - 1)])


def _coarse(
    lines: NDArray[np.float64], density: NDArray[np.float64], edges: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the largest density in each band; for a band without a line, that of the nearest line."""
    first, last = np.searchsorted(lines, edges[:-1]), np.searchsorted(lines, edges[1:], side="right")
    centres = np.sqrt(edges[:-1] * edges[1:])
    return np.array(
        [
            density[begin:end].max() if end > begin else density[np.abs(lines - centre).argmin()]
            for begin, end, centre in zip(first, last, centres, strict=True)
        ]
    )
