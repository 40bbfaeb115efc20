"""How linear a rig is, in plain words: one sentence for each response."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identifier.uncertainty.distortion import DistortionLevels

BAND_OCTAVES = 1.0 / 3.0
"""Width over which levels are averaged before the worst place is named: one line alone is mostly chance."""

FEWEST_LINES = 9
"""Lines averaged at least."""

SIGNIFICANCE = 5.0
"""Standard errors of a rig without distortion that are exceeded where one is found: many places are looked at."""

SMALLEST_SHARE = 1e-6
"""Below this a share is rounding."""


@dataclass(frozen=True)
class Shares:
    """RMS of something over the RMS of the response, in the band, for each response; 0 where nothing was found.

    Parameters
    ----------
    over_band
        Shape (responses).
    worst
        Shape (responses): the largest over a third of an octave.
    worst_frequency
        Shape (responses): where, in hertz; 0 where nothing was found.
    """

    over_band: NDArray[np.float64]
    worst: NDArray[np.float64]
    worst_frequency: NDArray[np.float64]


def distortion_shares(levels: DistortionLevels) -> Shares:
    """Share of each response that is stochastic nonlinear distortion.

    Parameters
    ----------
    levels
        From the robust method.

    Returns
    -------
    Shares
        Found where it exceeds what noise alone would scatter by `SIGNIFICANCE` times.
    """
    # What a linear rig would show: two estimates of its noise, from the experiments and from the periods.
    freedom = 1.0 / levels.degrees_of_freedom + 1.0 / (levels.experiments * (levels.periods - 1))
    noise = levels.noise_psd / levels.periods
    return _shares(
        levels.frequency, levels.excited, levels.distortion_psd, levels.response_psd, noise=noise, freedom=freedom
    )


def noise_shares(levels: DistortionLevels) -> Shares:
    """Share of each response that is noise, of one period.

    Parameters
    ----------
    levels
        From the robust method.

    Returns
    -------
    Shares
        Of every response.
    """
    return _shares(levels.frequency, levels.excited, levels.noise_psd, levels.response_psd)


def unexplained_shares(
    frequency: NDArray[np.float64],
    *,
    lines: NDArray[np.bool_],
    residual_psd: NDArray[np.float64],
    response_psd: NDArray[np.float64],
) -> Shares:
    """Share of each response that the drives do not explain, noise and distortion together.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz.
    lines
        Shape (lines): where something was estimated.
    residual_psd, response_psd
        Shape (lines, responses), one-sided densities.

    Returns
    -------
    Shares
        Of every response.
    """
    return _shares(frequency, lines, residual_psd, response_psd)


def separated_verdicts(levels: DistortionLevels, *, responses: Sequence[str]) -> tuple[str, ...]:
    """Say how nonlinear and how noisy each response is.

    Parameters
    ----------
    levels
        From the robust method.
    responses
        Names of the channels, in order.

    Returns
    -------
    tuple of str
        One sentence for each.
    """
    nonlinear, noise = distortion_shares(levels), noise_shares(levels)
    sentences = []
    for i, name in enumerate(responses):
        channel = name.replace("_", " ")
        share = f"noise {_percent(noise.over_band[i])} over the band"
        if nonlinear.worst_frequency[i] == 0.0:
            sentences.append(f"No nonlinearity beyond the noise in {channel}; {share}.")
        else:
            sentences.append(
                f"Nonlinear {_percent(nonlinear.worst[i])} of the response at {nonlinear.worst_frequency[i]:.3g} Hz in "
                f"{channel}, {_percent(nonlinear.over_band[i])} over the band{_parity(levels, i)}; {share}."
            )
    return tuple(sentences)


def unexplained_verdicts(shares: Shares, *, responses: Sequence[str]) -> tuple[str, ...]:
    """Say how much of each response the drives do not explain, where noise and distortion cannot be told apart.

    Parameters
    ----------
    shares
        From `unexplained_shares`.
    responses
        Names of the channels, in order.

    Returns
    -------
    tuple of str
        One sentence for each.
    """
    return tuple(
        f"Noise and nonlinearity together {_percent(shares.worst[i])} of the response at "
        f"{shares.worst_frequency[i]:.3g} Hz in {name.replace('_', ' ')}, {_percent(shares.over_band[i])} over the "
        "band."
        for i, name in enumerate(responses)
    )


def _shares(
    frequency: NDArray[np.float64],
    lines: NDArray[np.bool_],
    part: NDArray[np.float64],
    whole: NDArray[np.float64],
    *,
    noise: NDArray[np.float64] | None = None,
    freedom: float = 0.0,
) -> Shares:
    by_chance = np.zeros_like(part) if noise is None else noise
    held = np.flatnonzero(lines)

    def share(piece: NDArray[np.intp]) -> NDArray[np.float64]:
        amount, total = np.sum(part[piece], axis=0), np.sum(whole[piece], axis=0)
        chance = np.sum(by_chance[piece], axis=0)
        squares = np.sum(by_chance[piece] ** 2, axis=0)
        # The logarithm of a ratio of two estimates scatters evenly to both sides, the ratio itself does not.
        scatter = np.sqrt(freedom * np.divide(squares, chance**2, out=np.zeros_like(chance), where=chance > 0.0))
        least = np.maximum(chance * np.expm1(SIGNIFICANCE * scatter), SMALLEST_SHARE**2 * total)
        return np.sqrt(np.where(amount > least, amount, 0.0) / total)

    worst, where = np.zeros(part.shape[1]), np.zeros(part.shape[1])
    for low, high in _windows(frequency[held]):
        piece = held[low:high]
        ratio = share(piece)
        better = ratio > worst
        worst = np.where(better, ratio, worst)
        where = np.where(better, frequency[piece[len(piece) // 2]], where)
    return Shares(over_band=share(held), worst=worst, worst_frequency=where)


def _windows(frequency: NDArray[np.float64]) -> list[tuple[int, int]]:
    """First and stop of the lines within a third of an octave about every line, `FEWEST_LINES` at least."""
    ratio = 2.0 ** (BAND_OCTAVES / 2.0)
    low = np.searchsorted(frequency, frequency / ratio)
    high = np.searchsorted(frequency, frequency * ratio, side="right")
    lines, least = frequency.size, min(FEWEST_LINES, frequency.size)
    windows = []
    for index in range(lines):
        first, stop = int(low[index]), int(high[index])
        if stop - first < least:
            first = min(max(0, index - least // 2), lines - least)
            stop = first + least
        windows.append((first, stop))
    return windows


def _parity(levels: DistortionLevels, response: int) -> str:
    if levels.odd_psd is None or levels.even_psd is None:
        return ""
    means = []
    for psd in (levels.odd_psd, levels.even_psd):
        held = psd[:, response] != 0.0
        # Each kind is seen at some lines only; its mean density stands for all.
        means.append(max(0.0, float(np.mean(psd[held, response]))) if held.any() else 0.0)
    mean_response = float(np.mean(levels.response_psd[levels.excited, response]))
    odd, even = (np.sqrt(mean / mean_response) for mean in means)
    return f" (odd {_percent(odd)}, even {_percent(even)})"


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.2g} %" if percent < 10.0 else f"{percent:.0f} %"
