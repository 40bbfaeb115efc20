"""H1, H2 and Hv from averaged spectra, with coherence, condition and residual."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from duralab_settings import EstimatorKind
from identifier.estimators.averaged_spectra import AveragedSpectra
from identifier.estimators.coherence import multiple_coherence, require_audible
from identifier.estimators.condition import drive_condition, unit_diagonal
from identifier.estimators.frf_estimate import FrfEstimate, ModelWarning, WarningCode
from identifier.estimators.h1 import h1
from identifier.estimators.h2 import h2
from identifier.estimators.hv import hv

T = TypeVar("T", bound=np.generic)


def estimate_from_spectra(
    kind: EstimatorKind, spectra: AveragedSpectra, *, warnings: tuple[ModelWarning, ...] = ()
) -> FrfEstimate:
    """Estimate an FRF matrix from averaged spectra.

    `kind`: H1, H2 or Hv. `spectra`: Averages of `SpectralSums`. `warnings`: Warnings about the record.
    Returns: Estimate at the excited lines.
    Raises `ValueError`: A drive or a response is silent at an excited line, the drives are dependent, or the estimator
    does not fit the channels.
    """
    lines = np.flatnonzero(spectra.lines)
    frequency = spectra.frequency[lines]
    s_uu, s_yu, auto_y = spectra.s_uu[lines], spectra.s_yu[lines], spectra.auto_y[lines]
    scale, scaled = unit_diagonal(s_uu, frequency)
    condition = drive_condition(scaled, frequency)
    require_audible(auto_y, frequency)
    least_squares = h1(s_yu, scaled, scale)
    if kind is EstimatorKind.H1:
        frf = least_squares
    elif kind is EstimatorKind.H2:
        if spectra.s_yy is None:
            raise ValueError("H2 needs all of S_yy; average the spectra with `full=True`.")
        frf = h2(spectra.s_yy[lines], s_yu, frequency)
    elif kind is EstimatorKind.HV:
        frf = hv(auto_y, s_yu, scaled, scale)
    else:
        raise ValueError(f"{kind.value} does not start from averaged spectra; take h1, h2 or hv.")

    size, n_u = spectra.frequency.size, s_uu.shape[1]
    freedom = max(spectra.independent_averages - n_u, 0.0)
    residual = _unexplained(frf, s_uu, s_yu, auto_y)
    if freedom > 0.0:
        residual *= spectra.independent_averages / freedom
    else:
        residual[:] = 0.0
        warnings = (*warnings, _few_averages(spectra.independent_averages, n_u))
    return FrfEstimate(
        frequency=spectra.frequency,
        frf=on_all_lines(frf, lines, size),
        coherence=on_all_lines(multiple_coherence(least_squares, s_yu, auto_y), lines, size),
        condition_number=on_all_lines(condition, lines, size),
        s_uu=spectra.s_uu,
        response_psd=spectra.auto_y,
        blocks=spectra.blocks,
        independent_averages=spectra.independent_averages,
        valid=spectra.lines.copy(),
        residual_psd=on_all_lines(residual, lines, size),
        degrees_of_freedom=np.where(spectra.lines, freedom, 0.0),
        averages=np.where(spectra.lines, spectra.independent_averages, 0.0),
        kind=kind,
        warnings=warnings,
    )


def on_all_lines(values: NDArray[T], lines: NDArray[np.intp], size: int) -> NDArray[T]:
    """Return estimates on the whole grid, 0 at the other lines."""
    result = np.zeros((size, *values.shape[1:]), dtype=values.dtype)
    result[lines] = values
    return result


def _unexplained(
    frf: NDArray[np.complex128],
    s_uu: NDArray[np.complex128],
    s_yu: NDArray[np.complex128],
    auto_y: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the power of ``Y - H U``; 0 if rounding would make it negative."""
    predicted = np.einsum("fij,fij->fi", frf @ s_uu, frf.conj()).real
    shared = np.einsum("fij,fij->fi", frf, s_yu.conj()).real
    return np.maximum(auto_y - 2.0 * shared + predicted, 0.0)


def _few_averages(averages: float, drives: int) -> ModelWarning:
    return ModelWarning(
        WarningCode.FEW_AVERAGES,
        f"{averages:.3g} independent averages of {drives} drives leave nothing to judge the noise by; take a longer "
        "experiment, more realisations or shorter blocks.",
    )
