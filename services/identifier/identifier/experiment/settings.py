"""What an identification is asked for: how to excite the rig, and how to estimate from its response."""

from dataclasses import dataclass

from duralab_settings import EstimatorSettings
from identifier.excitation import ExperimentSettings


@dataclass(frozen=True)
class IdentificationSettings:
    """One identification, sound by itself.

    Parameters
    ----------
    excitation
        What is played, for how long, in which blocks.
    estimator
        How the record becomes a model.
    """

    excitation: ExperimentSettings
    estimator: EstimatorSettings
