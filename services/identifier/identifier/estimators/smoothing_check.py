"""Whether a local method smoothed a resonance away: its FRF beside H1 of the same captures, which do not leak."""

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.averaged_spectra import AveragedSpectra
from identifier.estimators.condition import unit_diagonal
from identifier.estimators.frf_estimate import ModelWarning, WarningCode
from identifier.estimators.h1 import h1

NOTICED_SHARE = 0.02
"""Smallest difference, as a share of a response's RMS, that is worth a warning."""

_TIMES_CHANCE = 2.0

_LEFT_OUT = 0.05
"""Share of the difference below the band that a warning names, and above it."""


def smoothing_warnings(
    spectra: AveragedSpectra, frf: NDArray[np.complex128], residual_psd: NDArray[np.float64]
) -> tuple[ModelWarning, ...]:
    """Compare a local estimate with H1 of captures that do not leak; name the responses where they disagree.

    Both predict the response to the drives that were played. Chance moves H1's prediction by ``n_u / N`` of the
    residual spectrum; beyond twice that, the FRF bends more over the neighbouring lines than the method follows.

    Parameters
    ----------
    spectra
        Of captures without a window.
    frf
        By the local method, shape (excited lines, responses, drives).
    residual_psd
        Of the local method, shape (excited lines, responses).

    Returns
    -------
    tuple of ModelWarning
        One for each response concerned; `size` is the difference as a share of the response's RMS, `band` holds nine
        tenths of its power.
    """
    lines = np.flatnonzero(spectra.lines)
    s_uu, s_yu, auto_y = spectra.s_uu[lines], spectra.s_yu[lines], spectra.auto_y[lines]
    scale, scaled = unit_diagonal(s_uu, spectra.frequency[lines])
    drives = s_uu.shape[1]
    unsmoothed = h1(s_yu, scaled, scale)
    difference = frf - unsmoothed
    power = np.einsum("fij,fjk,fik->fi", difference, s_uu, difference.conj(), optimize=True).real
    freedom = spectra.independent_averages - drives
    if freedom > 0.0:
        explained = np.einsum("fij,fij->fi", unsmoothed, s_yu.conj()).real
        residual_psd = (auto_y - explained) * spectra.independent_averages / freedom
    beyond_chance = power - _TIMES_CHANCE * drives / spectra.independent_averages * residual_psd
    total = np.sum(auto_y, axis=0)
    share = np.sqrt(np.maximum(np.sum(beyond_chance, axis=0), 0.0) / total)
    return tuple(
        _warning(int(channel), float(share[channel]), spectra.frequency[lines], beyond_chance[:, channel])
        for channel in np.flatnonzero(share > NOTICED_SHARE)
    )


def _warning(
    channel: int, share: float, frequency: NDArray[np.float64], beyond_chance: NDArray[np.float64]
) -> ModelWarning:
    below = np.cumsum(np.maximum(beyond_chance, 0.0))
    first, last = np.searchsorted(below, [_LEFT_OUT * below[-1], (1.0 - _LEFT_OUT) * below[-1]])
    lowest, highest = float(frequency[first]), float(frequency[last])
    return ModelWarning(
        code=WarningCode.SMOOTHED,
        sentence=(
            f"What the local method says of response {channel} differs by {100.0 * share:.2g} % of its RMS from h1 of "
            f"the same captures, most of it between {lowest:.4g} and {highest:.4g} Hz: the FRF bends too much over the "
            "neighbouring lines, so take h1, a smaller half-width or longer blocks."
        ),
        channel=channel,
        size=share,
        band=(lowest, highest),
    )
