"""Bias of a local method: its FRF compared with one that is free from line to line, or with one over fewer lines.

A polynomial over a neighbourhood wider than a resonance smooths the resonance. If captures do not leak, H1 is free of
that; if they do, the same method over fewer lines is less biased.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from identifier.estimators.averaged_spectra import AveragedSpectra
from identifier.estimators.condition import unit_diagonal
from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.estimators.h1 import h1
from identifier.estimators.local_regression import LocalSums
from identifier.estimators.local_solution import LocalSolution

NOTICED_SHARE = 0.02
"""Smallest bias that causes a warning, as a share of a response's RMS."""

SMALLEST_SURPLUS = 1.5
"""Ratio of equations to unknowns below which noise is amplified."""

AMPLE_SURPLUS = 2.0
"""Smallest ratio of equations to unknowns with the methods' own widths."""

_TIMES_CHANCE = 2.0

_SECOND_DIFFERENCE = 6.0
"""Power of the second difference of independent values over their own power."""

_FEWEST_LINES = 3

_FEWEST_NEIGHBOURS = 16
"""Smallest number of lines to either side for the median of the change from line to line."""

_LEFT_OUT = 0.05
"""Share of the difference below the band that a warning names, and above it."""


@dataclass(frozen=True)
class Neighbourhood:
    """Neighbourhood of a local method, and its smallest alternative.

    `half_width`: Lines to either side. `hertz`: Width of the whole neighbourhood. `fewest`: Smallest half width that
    gives twice as many equations as unknowns.
    """

    half_width: int
    hertz: float
    fewest: int

    @classmethod
    def of(cls, sums: LocalSums) -> "Neighbourhood":
        """Return the neighbourhood of a regression."""
        return cls(
            half_width=sums.model.half_width, hertz=2.0 * sums.reach, fewest=sums.fewest_half_width(AMPLE_SURPLUS)
        )


def few_equations(sums: LocalSums) -> tuple[ModelWarning, ...]:
    """Warn of a neighbourhood that hardly determines its unknowns, so that noise is amplified."""
    least, now = sums.fewest_half_width(SMALLEST_SURPLUS), sums.model.half_width
    if now >= least:
        return ()
    sentence = (
        f"A local_half_width of {now} gives hardly more equations than the {sums.unknowns} unknowns of a line, so that "
        f"noise is amplified; take at least {sums.fewest_half_width(AMPLE_SURPLUS)}, a longer experiment, or h1."
    )
    return (ModelWarning(WarningCode.FEW_AVERAGES, sentence),)


def differences_from_h1(
    spectra: AveragedSpectra,
    solution: LocalSolution,
    neighbourhood: Neighbourhood,
    *,
    transients: NDArray[np.float64],
    other_phases: bool,
    sweeps: bool,
) -> tuple[ModelWarning, ...]:
    """Compare a local estimate with H1 of captures without a window; report the responses that disagree.

    Both predict the response to the played drives. Chance changes H1's prediction by ``n_u / N`` of the residual
    spectrum, or, if the residual does not show it, by the change from one line to the next. Beyond twice that, the
    local method is biased.
    """
    lines = np.flatnonzero(spectra.lines)
    s_uu, s_yu, auto_y = spectra.s_uu[lines], spectra.s_yu[lines], spectra.auto_y[lines]
    scale, scaled = unit_diagonal(s_uu, spectra.frequency[lines])
    drives = s_uu.shape[1]
    unsmoothed = h1(s_yu, scaled, scale)
    difference = solution.frf - unsmoothed
    freedom = spectra.independent_averages - drives
    chance = np.zeros_like(auto_y)
    if freedom > 0.0:
        explained = np.einsum("fij,fij->fi", unsmoothed, s_yu.conj()).real
        chance = drives / freedom * np.maximum(auto_y - explained, 0.0)
    if freedom <= 0.0 or not other_phases:
        chance = np.maximum(chance, jaggedness(unsmoothed, s_uu, neighbourhood.half_width))
    return _warnings(
        predicted_power(difference, s_uu),
        chance,
        auto_y,
        frequency=spectra.frequency[lines],
        least=np.maximum(NOTICED_SHARE, transients),
        judge="h1 of the same captures shows",
        # With few lines the start of a sweep's drive cannot be distinguished from a transient.
        remedy="take h1 or random_orthogonal" if sweeps else f"take h1{_or_narrower(neighbourhood)}",
        neighbourhood=neighbourhood,
    )


def differences_from_narrower(
    spectra: AveragedSpectra,
    solution: LocalSolution,
    neighbourhood: Neighbourhood,
    *,
    narrower: LocalSolution,
    share: NDArray[np.float64],
    bias_order: int,
) -> tuple[ModelWarning, ...]:
    """Compare a local estimate with one over fewer lines; report the responses that disagree.

    `share`: Shape (excited lines): width of the narrower neighbourhood over that of `solution`, below 1.
    """
    lines = np.flatnonzero(spectra.lines)
    s_uu, auto_y = spectra.s_uu[lines], spectra.auto_y[lines]
    # Least squares over more lines is the better of two estimates: the variance of their difference is its advantage.
    weight = np.maximum(narrower.drive_weight - solution.drive_weight, 0.0)
    chance = np.sum(np.einsum("fjj->fj", s_uu).real * weight, axis=1)[:, None] * narrower.residual_psd
    remaining = ((1.0 - share**bias_order) ** 2)[:, None]
    return _warnings(
        predicted_power(solution.frf - narrower.frf, s_uu) / remaining,
        chance / remaining,
        auto_y,
        frequency=spectra.frequency[lines],
        least=np.full(auto_y.shape[1], NOTICED_SHARE),
        judge="the same method over fewer lines shows",
        remedy=f"take random_orthogonal with h1{_or_narrower(neighbourhood)}",
        neighbourhood=neighbourhood,
    )


def predicted_power(difference: NDArray[np.complex128], s_uu: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the response density of an FRF, shape (lines, responses, drives), with the drives, (lines, responses)."""
    return np.einsum("fij,fjk,fik->fi", difference, s_uu, difference.conj(), optimize=True).real


def jaggedness(frf: NDArray[np.complex128], s_uu: NDArray[np.complex128], half_width: int) -> NDArray[np.float64]:
    """Return the power that is independent from line to line, (lines, responses): no curvature, no few narrow modes.

    Second differences remove slow curvature, their median over the neighbourhood removes peaks at few lines.
    """
    if frf.shape[0] < _FEWEST_LINES:
        return np.zeros(frf.shape[:2])
    bend = np.diff(frf, n=2, axis=0)
    power = predicted_power(np.concatenate([bend[:1], bend, bend[-1:]]), s_uu) / _SECOND_DIFFERENCE
    return median_filter(power, size=(2 * max(half_width, _FEWEST_NEIGHBOURS) + 1, 1), mode="nearest")


def _or_narrower(neighbourhood: Neighbourhood) -> str:
    if neighbourhood.fewest >= neighbourhood.half_width:
        return " or longer blocks"
    return f", longer blocks or a smaller local_half_width, at least {neighbourhood.fewest}"


def _warnings(
    power: NDArray[np.float64],
    chance: NDArray[np.float64],
    auto_y: NDArray[np.float64],
    *,
    frequency: NDArray[np.float64],
    least: NDArray[np.float64],
    judge: str,
    remedy: str,
    neighbourhood: Neighbourhood,
) -> tuple[ModelWarning, ...]:
    total = np.sum(auto_y, axis=0)
    beyond = power - _TIMES_CHANCE * chance
    found = np.sqrt(np.maximum(np.sum(beyond, axis=0), 0.0) / total) > least
    size = np.sqrt(np.maximum(np.sum(power - chance, axis=0), 0.0) / total)
    warnings = []
    for channel in np.flatnonzero(found):
        below = np.cumsum(np.maximum(beyond[:, channel], 0.0))
        first, last = np.searchsorted(below, [_LEFT_OUT * below[-1], (1.0 - _LEFT_OUT) * below[-1]])
        band = (float(frequency[first]), float(frequency[last]))
        sentence = (
            f"The local method errs in response {channel} by about {100.0 * size[channel]:.2g} % of its RMS, most of "
            f"it between {band[0]:.4g} and {band[1]:.4g} Hz, as {judge}: within its neighbourhood of "
            f"{neighbourhood.hertz:.3g} Hz the FRF bends more than it follows; {remedy}."
        )
        warnings.append(
            ModelWarning(WarningCode.SMOOTHED, sentence, channel=int(channel), size=float(size[channel]), band=band)
        )
    return tuple(warnings)
