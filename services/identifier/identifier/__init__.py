"""Identification of a rig: excitation, the H1 estimator, its uncertainty; a pure core and a service around it.

Core: `pure_random` makes a drive, `estimate_h1` the FRF matrix from a drive and its response, `frf_variance` says how
far to trust it. The service (`python -m identifier --config FILE`) plays on a rig of the bus and answers a model.
"""

from identifier.excitation import check_levels, linear_fades, make_drive, pure_random
from identifier.experiment import estimate_experiment
from identifier.h1 import LARGEST_CONDITION, FrfEstimate, estimate_h1, h1_from_spectra
from identifier.model import IdentifiedModel, content_hash, from_message, to_message, with_id
from identifier.rig_under_test import RigUnderTest, check_against_rig
from identifier.settings import ExperimentSettings, SettingError, WhitePink
from identifier.uncertainty import frf_variance, relative_magnitude_variance

__all__ = [
    "LARGEST_CONDITION",
    "ExperimentSettings",
    "FrfEstimate",
    "IdentifiedModel",
    "RigUnderTest",
    "SettingError",
    "WhitePink",
    "check_against_rig",
    "check_levels",
    "content_hash",
    "estimate_experiment",
    "estimate_h1",
    "frf_variance",
    "from_message",
    "h1_from_spectra",
    "linear_fades",
    "make_drive",
    "pure_random",
    "relative_magnitude_variance",
    "to_message",
    "with_id",
]
