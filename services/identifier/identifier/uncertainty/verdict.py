"""Linearity of a rig in one sentence for each response."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identifier.uncertainty.distortion import DistortionLevels

BAND_OCTAVES = 1.0 / 3.0
"""Width in octaves over which levels are averaged to find the worst band: a single line is mostly chance."""

FEWEST_LINES = 9
"""Smallest number of averaged lines."""

SIGNIFICANCE = 5.0
"""Smallest significant excess, in standard errors of a rig without distortion, because many bands are tested."""

SMALLEST_SHARE = 1e-6
"""Smallest share; a smaller one is rounding."""


@dataclass(frozen=True)
class Shares:
    """RMS of a contribution over the RMS of the response, in the band, for each response; 0 if nothing was found.

    `over_band`: Shape (responses). `worst`: Shape (responses): the largest over a third of an octave.
    `worst_frequency`: Shape (responses): its frequency, in hertz; 0 if nothing was found.
    """

    over_band: NDArray[np.float64]
    worst: NDArray[np.float64]
    worst_frequency: NDArray[np.float64]


def distortion_shares(levels: DistortionLevels) -> Shares:
    """Return the share of each response that is stochastic nonlinear distortion.

    `levels`: Levels from the robust method.
    Returns: Shares that exceed the scatter of noise alone by `SIGNIFICANCE` times.
    """
    # Values of a linear rig: two estimates of its noise, from the experiments and from the periods.
    freedom = 1.0 / levels.degrees_of_freedom + 1.0 / (levels.experiments * (levels.periods - 1))
    noise = levels.noise_psd / levels.periods
    return _shares(
        levels.frequency, levels.excited, levels.distortion_psd, levels.response_psd, noise=noise, freedom=freedom
    )


def noise_shares(levels: DistortionLevels) -> Shares:
    """Return the share of each response that is noise, for one period.

    `levels`: Levels from the robust method.
    Returns: Shares of every response.
    """
    return _shares(levels.frequency, levels.excited, levels.noise_psd, levels.response_psd)


def unexplained_shares(
    frequency: NDArray[np.float64],
    *,
    lines: NDArray[np.bool_],
    residual_psd: NDArray[np.float64],
    response_psd: NDArray[np.float64],
) -> Shares:
    """Return the share of each response that the drives do not explain, noise and distortion together.

    `frequency`: Shape (lines), in hertz. `lines`: Shape (lines): estimated lines. `residual_psd`,
    `response_psd`: Shape (lines, responses), one-sided densities; without bias the first may be the larger one by
    chance.
    Returns: Shares of every response, at most 1.
    """
    found = _shares(frequency, lines, residual_psd, response_psd)
    # Bounded over all lines of a share and not at each: a bound at single lines would make the sum too small.
    return Shares(
        over_band=np.minimum(found.over_band, 1.0),
        worst=np.minimum(found.worst, 1.0),
        worst_frequency=found.worst_frequency,
    )


def left_out_shares(levels: DistortionLevels) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return odd and even distortion as shares of each response, from the lines that were left out."""
    if levels.odd_psd is None or levels.even_psd is None or levels.left_out_noise_psd is None:
        return None
    freedom = (1.0 + 1.0 / (levels.periods - 1)) / levels.experiments
    response = np.mean(levels.response_psd[levels.excited], axis=0)

    def share(psd: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
        held = np.any(psd != 0.0, axis=1)
        whole = response * np.sum(held)
        amount = np.sum(psd[held], axis=0)
        least = np.maximum(_by_chance(noise[held] / levels.periods, freedom), SMALLEST_SHARE**2 * whole)
        return np.sqrt(np.divide(amount, whole, out=np.zeros_like(amount), where=amount > least))

    return share(levels.odd_psd, levels.left_out_noise_psd), share(levels.even_psd, levels.left_out_noise_psd)


def separated_verdicts(
    levels: DistortionLevels, *, responses: Sequence[str], unsettled: Collection[int] = ()
) -> tuple[str, ...]:
    """Return a sentence on the nonlinearity and noise of each response.

    Parameters
    ----------
    levels
        Levels from the robust method.
    responses
        Names of the channels, in order.
    unsettled
        Numbers of the responses with a transient left in the captures: it changes from period to period and from one
        experiment to the next, as noise and distortion do.

    Returns
    -------
    tuple of str
        One sentence for each.
    """
    nonlinear, noise, left_out = distortion_shares(levels), noise_shares(levels), left_out_shares(levels)
    sentences = []
    for i, name in enumerate(responses):
        channel = name.replace("_", " ")
        share = f"noise {_percent(noise.over_band[i])} over the band"
        if i in unsettled:
            share += "; a transient that is left counts as either, so take more delay blocks to tell"
        parity = "" if left_out is None else f" (odd {_percent(left_out[0][i])}, even {_percent(left_out[1][i])})"
        if nonlinear.worst_frequency[i] > 0.0:
            sentences.append(
                f"Nonlinear {_percent(nonlinear.worst[i])} of the response at {nonlinear.worst_frequency[i]:.3g} Hz in "
                f"{channel}, {_percent(nonlinear.over_band[i])} over the band{parity}; {share}."
            )
        elif left_out is not None and (left_out[0][i] > 0.0 or left_out[1][i] > 0.0):
            # Squares of odd lines are only at even lines, not at the odd ones.
            sentences.append(f"Nonlinear at the lines left out in {channel}{parity}; {share}.")
        else:
            sentences.append(f"No nonlinearity beyond the noise in {channel}; {share}.")
    return tuple(sentences)


def unexplained_verdicts(shares: Shares, *, responses: Sequence[str]) -> tuple[str, ...]:
    """Return a sentence on the unexplained share of each response if its causes cannot be distinguished.

    `shares`: From `unexplained_shares`. `responses`: Names of the channels, in order.
    Returns: One sentence for each.
    """
    return tuple(
        f"Unexplained {_percent(shares.worst[i])} of the response at {shares.worst_frequency[i]:.3g} Hz in "
        f"{name.replace('_', ' ')}, {_percent(shares.over_band[i])} over the band: noise, nonlinearity, leakage and "
        "misfit together."
        if shares.worst_frequency[i] > 0.0
        else f"Everything is explained in {name.replace('_', ' ')}."
        for i, name in enumerate(responses)
    )


def unknown_verdicts(*, responses: Sequence[str]) -> tuple[str, ...]:
    """Return sentences that an experiment does not show the linearity of the rig.

    `responses`: Names of the channels, in order.
    Returns: One sentence for each.
    """
    return tuple(
        f"This experiment does not show how linear {name.replace('_', ' ')} is: play two realisations of a multisine, "
        "or noise."
        for name in responses
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
    of_noise = np.zeros_like(part) if noise is None else noise
    held = np.flatnonzero(lines)

    def share(piece: NDArray[np.intp]) -> NDArray[np.float64]:
        amount, total = np.sum(part[piece], axis=0), np.sum(whole[piece], axis=0)
        least = np.maximum(_by_chance(of_noise[piece], freedom), SMALLEST_SHARE**2 * total)
        return np.sqrt(np.where(amount > least, amount, 0.0) / total)

    worst, where = np.zeros(part.shape[1]), np.zeros(part.shape[1])
    for low, high in _windows(frequency[held]):
        piece = held[low:high]
        ratio = share(piece)
        better = ratio > worst
        worst = np.where(better, ratio, worst)
        where = np.where(better, frequency[piece[len(piece) // 2]], where)
    return Shares(over_band=share(held), worst=worst, worst_frequency=where)


def _by_chance(noise: NDArray[np.float64], freedom: float) -> NDArray[np.float64]:
    """Return a bound that the sum of differences of two estimates of this noise, (lines, responses), hardly exceeds."""
    total = np.sum(noise, axis=0)
    squares = np.sum(noise**2, axis=0)
    # The logarithm of a ratio of two estimates scatters evenly to both sides, unlike the ratio.
    scatter = np.sqrt(freedom * np.divide(squares, total**2, out=np.zeros_like(total), where=total > 0.0))
    return total * np.expm1(SIGNIFICANCE * scatter)


def _windows(frequency: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first and stop of the lines within a third of an octave about every line, `FEWEST_LINES` at least."""
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


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.2g} %" if percent < 10.0 else f"{percent:.0f} %"
