"""Common interface of all updates: `(history, model, settings) -> next drive`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, InstanceOf, field_validator

from duralab_settings import ResolvedUpdate, UpdateKind
from duralab_spectra import as_record
from iterator.band import ControlBand
from iterator.model import IterationHistory, Playback, RigModel
from iterator.updates.segment_acceptance import AcceptanceSettings


class UpdateSettings(ResolvedUpdate):
    """Settings of an update in addition to history and model; its other fields are those of `ResolvedUpdate`.

    Parameters
    ----------
    band : ControlBand
        Control band; drives get energy only in it.
    acceptance : AcceptanceSettings
        Settings of the composition of the best drive so far, used if `accept_segments` is set.
    smooth_lines : bool
        Adaptive Modelling: average the spectra over neighbouring lines, with weights 1 2 3 2 1, before the correction
        is formed.
    correction_overlap : float
        Adaptive Modelling: overlap of the averaged blocks, 0 up to but not including 1; three quarters use all data
        under a Hann window.
    energy_floor : float
        Adaptive Modelling: lines at which target, measured or predicted response has less than this share of its
        largest spectral density in the control band are not corrected; between 0 and 1.
    secant_overlap : float
        Secant update: overlap of the averaged blocks, 0 up to but not including 1.
    squares : bool
        Secant update: whether to learn the effect of the squares of the drives: arcs of levers, and springs that are
        stiffer in one direction. `secant.odd_terms` is the same for cubes and signed squares,
        `secant.speed_terms` for speeds.

    Raises
    ------
    TypeError
        The kind is not an `UpdateKind`.
    ValueError
        A value is not allowed, or gain and curve are for different numbers of responses.
    """

    band: InstanceOf[ControlBand]
    # A notebook may allow a larger correction than a campaign.
    largest_correction: float = Field(default=2.0, ge=1)
    acceptance: InstanceOf[AcceptanceSettings] = AcceptanceSettings()
    smooth_lines: bool = True
    correction_overlap: float = Field(default=0.75, ge=0, lt=1)
    energy_floor: float = Field(default=1e-8, gt=0, lt=1)
    secant_overlap: float = Field(default=0.5, ge=0, lt=1)
    squares: bool = True

    @field_validator("kind", mode="before")
    @classmethod
    def _require_kind(cls, kind: object) -> UpdateKind:
        if not isinstance(kind, UpdateKind):
            raise TypeError(
                f"The kind of update is {kind!r}; it must be an UpdateKind: pass your function as "
                "`run_campaign(..., update=function)`."
            )
        return kind

    @property
    def gains(self) -> NDArray[np.float64]:
        """Iteration gain of each response, shape (n_y,)."""
        return np.array(self.iteration_gain)

    @property
    def without_terms(self) -> UpdateSettings:
        """Settings for a secant update without nonlinear terms of the drives."""
        secant = self.secant.model_copy(update={"odd_terms": False, "speed_terms": False})
        return self.model_copy(update={"squares": False, "secant": secant})

    @property
    def without_rate_limits(self) -> UpdateSettings:
        """Settings for a secant update that looks for no rate limits of the actuators."""
        return self.model_copy(update={"secant": self.secant.model_copy(update={"rate_limits": False})})


@dataclass(frozen=True)
class NextDrive:
    """Result of an update.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Next drive, as long as the target; a mapped drive if the campaign has a drive map.
    model : RigModel
        Model that the drive was made with, for the next update.
    stepped_from : ndarray, shape (n_u, samples), or None
        The drive that the step was added to; None for the first, which starts from zero.
    """

    drive: NDArray[np.float64]
    model: RigModel
    stepped_from: NDArray[np.float64] | None = None


Update = Callable[[IterationHistory, RigModel, UpdateSettings], NextDrive]
"""Pure function of an update: the same result for the same arguments."""


def own_update(function: Update, *, name: str = "`update`") -> Update:
    """Return a function as an update with checked results, which cannot write to the history.

    `function`: `(history, model, settings) -> NextDrive`, as each of `UPDATES`. `name`: Name in error messages.
    Returns: Update that raises TypeError or ValueError unless the function returns a `NextDrive` of finite drives as
    long as the target, with a model of the same channels.
    Raises `TypeError`: `function` cannot be called.
    """
    if not callable(function):
        raise TypeError(f"`update` is {function!r}; it must be a function (history, model, settings) -> NextDrive.")

    def update(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
        step = function(_read_only(history), model, settings)
        if not isinstance(step, NextDrive):
            raise TypeError(f"{name} returned {type(step).__name__}; it must return a NextDrive(drive=..., model=...).")
        _require_fitting(step, history, model, name=name)
        return step

    return update


def _require_fitting(step: NextDrive, history: IterationHistory, model: RigModel, *, name: str) -> None:
    if not isinstance(step.model, RigModel) or step.model.frf.shape != model.frf.shape:
        raise ValueError(
            f"The model of the NextDrive that {name} returned is {type(step.model).__name__}; it must be a RigModel "
            f"with an FRF of the shape {model.frf.shape}: return the `model` that {name} was called with."
        )
    shape = (model.frf.shape[2], history.target.shape[1])
    records = {"drive": step.drive}
    if step.stepped_from is not None:
        records["stepped_from"] = step.stepped_from
    for part, record in records.items():
        found = as_record(record, name=f"{part} of the NextDrive that {name} returned").shape
        if found != shape:
            raise ValueError(
                f"{part} of the NextDrive that {name} returned has the shape {found}; it must be {shape}: drives of "
                "the model by samples of the target."
            )


def _read_only(history: IterationHistory) -> IterationHistory:
    def view(record: NDArray[np.float64]) -> NDArray[np.float64]:
        seen = record.view()
        seen.flags.writeable = False
        return seen

    playbacks = (Playback(view(played.drive), view(played.response)) for played in history.playbacks)
    start = history.start and Playback(view(history.start.drive), view(history.start.response))
    return IterationHistory(view(history.target), tuple(playbacks), start)
