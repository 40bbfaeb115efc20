"""One experiment with a rig: its settings, whether they fit the rig, its drive, and the estimate from its record."""

from identifier.experiment.estimate import estimate_experiment
from identifier.experiment.rig_under_test import RigUnderTest, check_against_rig, make_experiment, with_names
from identifier.experiment.settings import IdentificationSettings

__all__ = [
    "IdentificationSettings",
    "RigUnderTest",
    "check_against_rig",
    "estimate_experiment",
    "make_experiment",
    "with_names",
]
