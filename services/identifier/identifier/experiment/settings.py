"""What an identification is told to do: how to excite the rig, and how to estimate from its response."""

from dataclasses import dataclass

from identifier.estimators import EstimatorKind, EstimatorOptions
from identifier.excitation import ExcitationSettings
from identifier.setting_error import SettingError

LARGEST_LOCAL_ORDER = 6
"""A polynomial of a higher order follows the noise of its few lines."""

LARGEST_LOCAL_HALF_WIDTH = 1000
"""Lines to either side; a wider neighbourhood is not local."""


@dataclass(frozen=True)
class EstimatorSettings:
    """How the FRF is estimated.

    Parameters
    ----------
    kind
        The estimator.
    local_order
        Of the local methods: 1 to 6; None for 2.
    local_half_width
        Of the local methods: lines to either side, 1 to 1000; None for the method's own.

    Raises
    ------
    SettingError
        Where a value is not allowed.
    """

    kind: EstimatorKind = EstimatorKind.H1
    local_order: int | None = None
    local_half_width: int | None = None

    def __post_init__(self) -> None:
        for name, value, largest in (
            ("local_order", self.local_order, LARGEST_LOCAL_ORDER),
            ("local_half_width", self.local_half_width, LARGEST_LOCAL_HALF_WIDTH),
        ):
            if value is not None and not 1 <= value <= largest:
                raise SettingError(
                    f"{name} is {value}; it must be from 1 to {largest}, or be left out.", field=f"estimator.{name}"
                )

    @property
    def options(self) -> EstimatorOptions:
        """The same in the words of the estimators."""
        return EstimatorOptions(order=self.local_order, half_width=self.local_half_width)


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

    excitation: ExcitationSettings
    estimator: EstimatorSettings
