"""The one interface of all updates: `(history, model, settings) -> next drive`."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.band import ControlBand
from iterator.model import IterationHistory, Playback, RigModel
from iterator.updates.gains import GainCurve, require_shares
from iterator.updates.segment_acceptance import AcceptanceSettings
from spectra import as_record


class UpdateKind(enum.Enum):
    """How each next drive is made."""

    BASIC_TWR = "basic TWR"
    ADAPTIVE_MODELLING = "Adaptive Modelling"
    SECANT = "secant update"


class Prediction(enum.Enum):
    """What Adaptive Modelling compares."""

    FORWARD = "predicted with measured response, Eqs. 12 and 13"
    BACKWARD = "drive that the model predicts from the response with the one played"


class CorrectionShape(enum.Enum):
    """Which elements of a correction Adaptive Modelling estimates."""

    DIAGONAL = "channel by channel"
    FULL = "all channels with each other"


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
    prediction : Prediction
        Forward corrects the responses' side of the inverse, backward the drives' side.
    shape : CorrectionShape
        A full correction needs playbacks of many blocks; lines at which it is ill-conditioned are not corrected.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    smallest: float = 0.5
    largest: float = 2.0
    weigh_by_coherence: bool = True
    lowest_coherence: float = 0.7
    smooth_lines: bool = True
    overlap: float = 0.75
    energy_floor: float = 1e-8
    prediction: Prediction = Prediction.FORWARD
    shape: CorrectionShape = CorrectionShape.DIAGONAL

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


LARGEST_SECANT_WEIGHT: Final = 1e6
"""Beyond it a weight alone decides, and the sums it stands in lose what it is weighed against."""
LEAST_FORGETTING: Final = 1e-3
"""Less is as good as nothing, and its powers leave the range of floating point."""


@dataclass(frozen=True)
class SecantSettings:
    """How the secant update learns from the steps between playbacks.

    Parameters
    ----------
    forgetting : float
        `φ`: weight of a step relative to the one after it, in [0.001, 1].
    prior_strength : float
        `κ`: weight of the identified model relative to the steps' energy, in [1e-6, 1e6].
    caution : float
        `c_w`: share of the fit's uncertainty that the inverse minds, in [0, 1e6].
    regularisation : float
        `ρ`: relative to the median over lines of `tr(HᴴH) / n_u`, in [0, 1e6].
    overlap : float
        Of the blocks averaged, 0 up to but not including 1.
    squares : bool
        Whether to learn what the squares of the drives do, too: arcs of levers, and springs that are stiffer one way.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    forgetting: float = 0.7
    prior_strength: float = 1.0
    caution: float = 1.0
    regularisation: float = 1e-5
    overlap: float = 0.5
    squares: bool = True

    def __post_init__(self) -> None:
        for what, value, least, most in (
            ("forgetting", self.forgetting, LEAST_FORGETTING, 1.0),
            ("prior's strength", self.prior_strength, 1.0 / LARGEST_SECANT_WEIGHT, LARGEST_SECANT_WEIGHT),
            ("caution", self.caution, 0.0, LARGEST_SECANT_WEIGHT),
            ("regularisation", self.regularisation, 0.0, LARGEST_SECANT_WEIGHT),
        ):
            if not least <= value <= most:
                raise ValueError(f"The {what} is {value:g}; it must be {least:g} to {most:g}.")
        if not 0.0 <= self.overlap < 1.0:
            raise ValueError(f"The overlap is {self.overlap:g}; it must be 0 or more and less than 1.")


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
    secant : SecantSettings
        Used by the secant update only.
    acceptance : AcceptanceSettings, optional
        Every kind then steps from the best drive so far, stretch by stretch; from the last one where not given.
    gain_schedule : tuple of float
        Shares of the iteration gain for the first drive, the second, and so on, each in (0, 1]; the last holds on.
    gain_curve : GainCurve, optional
        Shares of the iteration gain over frequency.

    Raises
    ------
    TypeError
        The kind is not an `UpdateKind`.
    ValueError
        A gain or a share is not in (0, 1], or gain and curve are for different numbers of responses.
    """

    band: ControlBand
    iteration_gain: NDArray[np.float64]
    kind: UpdateKind = UpdateKind.SECANT
    correction: CorrectionSettings = CorrectionSettings()
    secant: SecantSettings = SecantSettings()
    acceptance: AcceptanceSettings | None = None
    gain_schedule: tuple[float, ...] = (1.0,)
    gain_curve: GainCurve | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.kind, UpdateKind):
            raise TypeError(
                f"The kind of update is {self.kind!r}; it must be an UpdateKind: pass a function of your own as "
                "`run_campaign(..., update=function)`."
            )
        gain = np.asarray(self.iteration_gain, dtype=np.float64)
        if gain.ndim != 1 or gain.size == 0:
            raise ValueError(f"The iteration gain has the shape {gain.shape}; it must be one value per response.")
        require_shares(gain, what="iteration gain of response")
        if not self.gain_schedule:
            raise ValueError("The gain schedule is empty; it needs a share for the first drive.")
        require_shares(np.asarray(self.gain_schedule, dtype=np.float64), what="share of the gain schedule")
        if self.gain_curve is not None and self.gain_curve.share.shape[1] != gain.size:
            raise ValueError(
                f"The gain curve is for {self.gain_curve.share.shape[1]} responses and the iteration gain for "
                f"{gain.size}; both must be equal."
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
    stepped_from : ndarray, shape (n_u, samples), or None
        The drive that the step was added to; None for the first, which starts from zero.
    """

    drive: NDArray[np.float64]
    model: RigModel
    stepped_from: NDArray[np.float64] | None = None


Update = Callable[[IterationHistory, RigModel, UpdateSettings], NextDrive]
"""An update: pure, and the same result for the same arguments."""


def own_update(function: Update) -> Update:
    """Return a function as an update whose results are checked, and that cannot write to the history.

    Parameters
    ----------
    function : callable
        `(history, model, settings) -> NextDrive`, as each of `UPDATES`.

    Returns
    -------
    callable
        Raises TypeError or ValueError where the function returns anything but a `NextDrive` of finite drives as long
        as the target, with a model of the same channels.

    Raises
    ------
    TypeError
        `function` cannot be called.
    """
    if not callable(function):
        raise TypeError(f"`update` is {function!r}; it must be a function (history, model, settings) -> NextDrive.")

    def update(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
        step = function(_read_only(history), model, settings)
        if not isinstance(step, NextDrive):
            raise TypeError(
                f"`update` returned {type(step).__name__}; it must return a NextDrive(drive=..., model=...)."
            )
        _require_fitting(step, history, model)
        return step

    return update


def _require_fitting(step: NextDrive, history: IterationHistory, model: RigModel) -> None:
    if not isinstance(step.model, RigModel) or step.model.frf.shape != model.frf.shape:
        raise ValueError(
            f"The model of the NextDrive that `update` returned is {type(step.model).__name__}; it must be a RigModel "
            f"with an FRF of the shape {model.frf.shape}: return the `model` that `update` was called with."
        )
    shape = (model.frf.shape[2], history.target.shape[1])
    records = {"drive": step.drive}
    if step.stepped_from is not None:
        records["stepped_from"] = step.stepped_from
    for name, record in records.items():
        found = as_record(record, name=f"{name} of the NextDrive that `update` returned").shape
        if found != shape:
            raise ValueError(
                f"{name} of the NextDrive that `update` returned has the shape {found}; it must be {shape}: drives of "
                "the model by samples of the target."
            )


def _read_only(history: IterationHistory) -> IterationHistory:
    def view(record: NDArray[np.float64]) -> NDArray[np.float64]:
        seen = record.view()
        seen.flags.writeable = False
        return seen

    playbacks = (Playback(view(played.drive), view(played.response)) for played in history.playbacks)
    return IterationHistory(view(history.target), tuple(playbacks))
