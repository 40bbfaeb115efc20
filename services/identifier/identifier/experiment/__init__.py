"""One experiment with a rig: its settings, their check against the rig, its drive, and the estimate from its record."""

from identifier.experiment.estimate import estimate_experiment
from identifier.experiment.rig_under_test import RigUnderTest, check_against_rig, make_experiment, with_names
from identifier.experiment.settings import IdentificationSettings
from identifier.experiment.static_gain import StaticGain, measured_static_gain, static_samples, static_warnings
from identifier.experiment.target_shaped import TargetShape, estimate_shaped, shape_of, shaped_experiment

__all__ = [
    "IdentificationSettings",
    "RigUnderTest",
    "StaticGain",
    "TargetShape",
    "check_against_rig",
    "estimate_experiment",
    "estimate_shaped",
    "make_experiment",
    "measured_static_gain",
    "shape_of",
    "shaped_experiment",
    "static_samples",
    "static_warnings",
    "with_names",
]
