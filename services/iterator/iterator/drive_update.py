"""The one interface of all updates: `(history, model, settings) -> next drive`."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iterator.control_band import ControlBand
from iterator.iteration_history import IterationHistory
from iterator.rig_model import RigModel


class UpdateKind(enum.Enum):
    """How each next drive is made."""

    BASIC_TWR = "basic TWR"
    ADAPTIVE_MODELLING = "Adaptive Modelling"


@dataclass(frozen=True)
class CorrectionSettings:
    """Safeguards of Adaptive Modelling.

    Parameters
    ----------
    smallest, largest : float
        Bounds of the magnitude of one correction, `0 < smallest <= 1 <= largest`.
    weigh_by_coherence : bool
        Shrink each correction towards 1 where measured and predicted response are not coherent.
    lowest_coherence : float
        Coherence up to which nothing is corrected; from there the weight rises linearly to 1. 0 up to but not
        including 1; used with `weigh_by_coherence` only.
    smooth_lines : bool
        Average the spectra over neighbouring lines, with weights 1 2 3 2 1, before the correction is formed.
    overlap : float
        Of the blocks averaged, 0 up to but not including 1; three quarters use all that a Hann window leaves.
    energy_floor : float
        Lines at which target, measured or predicted response has less than this share of its largest spectral density
        in the control band are not corrected; greater than 0.
    """

    smallest: float = 0.5
    largest: float = 2.0
    weigh_by_coherence: bool = True
    lowest_coherence: float = 0.7
    smooth_lines: bool = True
    overlap: float = 0.75
    energy_floor: float = 1e-8

    def __post_init__(self) -> None:
        if not (0.0 < self.smallest <= 1.0 <= self.largest < np.inf):
            raise ValueError(
                f"A correction is bounded by {self.smallest:g} and {self.largest:g}; the bounds must be finite, the "
                "smaller above 0 and at most 1, the larger at least 1."
            )
        if not 0.0 <= self.lowest_coherence < 1.0:
            raise ValueError(
                f"The lowest coherence is {self.lowest_coherence:g}; it must be 0 or more and less than 1."
            )
        if not 0.0 <= self.overlap < 1.0:
            raise ValueError(f"The overlap is {self.overlap:g}; it must be 0 or more and less than 1.")
        if not 0.0 < self.energy_floor < 1.0:
            raise ValueError(f"The energy floor is {self.energy_floor:g}; it must lie between 0 and 1.")


@dataclass(frozen=True)
class UpdateSettings:
    """What an update needs besides history and model.

    Parameters
    ----------
    band : ControlBand
        Drives get energy in it only.
    iteration_gain : ndarray, shape (n_y,)
        `q_i` of Eq. 2, each in (0, 1].
    kind : UpdateKind
        Which update.
    correction : CorrectionSettings
        Used by Adaptive Modelling only.
    """

    band: ControlBand
    iteration_gain: NDArray[np.float64]
    kind: UpdateKind = UpdateKind.ADAPTIVE_MODELLING
    correction: CorrectionSettings = CorrectionSettings()

    def __post_init__(self) -> None:
        gain = np.asarray(self.iteration_gain, dtype=np.float64)
        if gain.ndim != 1 or gain.size == 0:
            raise ValueError(f"The iteration gain has the shape {gain.shape}; it must be one value per response.")
        wrong = np.flatnonzero(~((gain > 0.0) & (gain <= 1.0)))
        if wrong.size:
            raise ValueError(
                f"The iteration gain of response {wrong[0]} is {gain[wrong[0]]:g}; it must be above 0 and at most 1."
            )
        object.__setattr__(self, "iteration_gain", gain)


@dataclass(frozen=True)
class NextDrive:
    """What an update returns.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        To be played next, as long as the target.
    model : RigModel
        What it was made with; goes into the next update.
    """

    drive: NDArray[np.float64]
    model: RigModel


Update = Callable[[IterationHistory, RigModel, UpdateSettings], NextDrive]
"""An update: pure, and the same result for the same arguments."""
