"""Settings of an identification: excitation and estimator."""

from dataclasses import dataclass

from duralab_settings import EstimatorSettings
from identifier.excitation import ExperimentSettings


@dataclass(frozen=True)
class IdentificationSettings:
    """Settings of one identification, valid when constructed.

    Parameters
    ----------
    excitation
        Played excitation, its duration and blocks.
    estimator
        Estimator of the model.
    learn_drive_map
        Whether a drive map is learned from the record.
    response_weight
        Weight of each response in learning the map; None: one over its RMS in the record.
    """

    excitation: ExperimentSettings
    estimator: EstimatorSettings
    learn_drive_map: bool = False
    response_weight: tuple[float, ...] | None = None
