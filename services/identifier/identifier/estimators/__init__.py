"""Estimators of an FRF matrix: H1, H2, Hv, local polynomial and local rational, streaming, with their checks.

`estimate` takes a record and its layout, `Estimation` the same in pieces.
"""

from identifier.estimators.averaged_spectra import AveragedSpectra, SpectralSums
from identifier.estimators.condition import LARGEST_CONDITION
from identifier.estimators.estimation import Estimation, EstimatorOptions, estimate
from identifier.estimators.frf_estimate import FrfEstimate, ModelWarning, WarningCode
from identifier.estimators.spectral import estimate_from_spectra

__all__ = [
    "LARGEST_CONDITION",
    "AveragedSpectra",
    "Estimation",
    "EstimatorOptions",
    "FrfEstimate",
    "ModelWarning",
    "SpectralSums",
    "WarningCode",
    "estimate",
    "estimate_from_spectra",
]
