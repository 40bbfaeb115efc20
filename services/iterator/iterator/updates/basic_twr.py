"""Basic Time Waveform Replication: update with a given inverse model, from the last drive or the best so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.band import ControlBand
from iterator.model import IterationHistory, Playback, RigModel, apply_inverse, stepped_drive
from iterator.updates.gains import gain_at
from iterator.updates.segment_acceptance import accept_segments
from iterator.updates.settings import NextDrive, UpdateSettings


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Return `U_{k+1} = U_k + Ĥ† Q E_k` (Eq. 2), or `U_1 = Ĥ† Q Y_d` before the first playback.

    With segment acceptance, `U_k` and `E_k` are those of the best drive so far, and the step is smaller in segments
    that the last step made worse.

    Source: Cornelis et al., ISMA 2014, Eqs. 2 and 3.
    """
    if not history.playbacks and history.start is None:
        return NextDrive(
            drive=apply_inverse(weighed_by_gain(history, model, settings), history.target, band=settings.band),
            model=model,
        )
    start = step_start(history, model, settings)
    drive = start.drive_toward(history.target, band=settings.band)
    return NextDrive(drive=drive, model=model, stepped_from=start.drive)


@dataclass(frozen=True)
class StepStart:
    """Start and largest size of a step.

    Parameters
    ----------
    model : RigModel
        Model whose inverse is multiplied by the iteration gain.
    drive : ndarray, shape (n_u, samples)
        Last drive, or the best so far.
    response : ndarray, shape (n_y, samples)
        Response of that drive.
    step_gain : ndarray, shape (samples,), or None
        Share of the step that is made at each instant; the whole step if None.
    """

    model: RigModel
    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    step_gain: NDArray[np.float64] | None

    @property
    def share(self) -> NDArray[np.float64] | float:
        """Share of the step that is made at each instant, 1 for the whole step."""
        return 1.0 if self.step_gain is None else self.step_gain

    def drive_toward(self, target: NDArray[np.float64], *, band: ControlBand) -> NDArray[np.float64]:
        """Return the drive that gives a target by the model, as far as the gain allows.

        Parameters
        ----------
        target : ndarray, shape (n_y, samples)
            Target in response units.
        band : ControlBand
            Band of the step's energy.

        Returns
        -------
        ndarray, shape (n_u, samples)
            Drive in drive units.
        """
        return stepped_drive(
            self.model,
            target,
            response=self.response,
            band=band,
            stepped_from=self.drive,
            step_gain=self.step_gain,
        )


def step_start(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> StepStart:
    """Return the start of the next step.

    Parameters
    ----------
    history : IterationHistory
        History; before the first playback the step starts from its `start`, or from rest.
    model : RigModel
        Model of the step.
    settings : UpdateSettings
        Settings with the gains and the acceptance.

    Returns
    -------
    StepStart
        Start from the last playback, or from the composition of segment acceptance.

    Raises
    ------
    ValueError
        Gain, target and model have different numbers of responses.
    """
    weighted = weighed_by_gain(history, model, settings)
    if not history.playbacks:
        samples = history.target.shape[1]
        first = history.start or Playback(np.zeros((model.frf.shape[2], samples)), np.zeros_like(history.target))
        return StepStart(weighted, first.drive, first.response, None)
    if not settings.accept_segments:
        last = history.playbacks[-1]
        return StepStart(weighted, last.drive, last.response, None)
    best = accept_segments(
        history,
        response_scale=response_scale(history, model),
        sample_rate=settings.band.sample_rate,
        settings=settings.acceptance,
        iteration_gain=[
            float(gain_at(model.frequency, settings, playbacks=number).min())
            for number in range(1, len(history.playbacks))
        ],
    )
    return StepStart(weighted, best.drive, best.response, best.step_gain)


def weighed_by_gain(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> RigModel:
    """Return the model with `Ĥ† Q` instead of `Ĥ†`."""
    responses = model.frf.shape[1]
    if history.target.shape[0] != responses or settings.gains.size != responses:
        raise ValueError(
            f"The model has {responses} responses, the target {history.target.shape[0]} and the iteration gain "
            f"{settings.gains.size}; all must be equal."
        )
    gain = gain_at(model.frequency, settings, playbacks=playbacks_before(history, model))
    return replace(model, inverse_frf=model.inverse_frf * gain[:, None, :])


def playbacks_before(history: IterationHistory, model: RigModel) -> int:
    """Return the number of playbacks that the next drive learns from, including those of earlier campaigns."""
    return len(history.playbacks) + sum(len(line) for line in model.earlier)


def response_scale(history: IterationHistory, model: RigModel) -> NDArray[np.float64]:
    """Return the weight of each response's error in the sum over responses."""
    level = rms(history.target)
    controlled = np.ones(level.size, dtype=bool) if model.response_weight is None else model.response_weight > 0.0
    silent = np.flatnonzero(controlled & (level <= 0.0))
    if silent.size:
        raise ValueError(
            f"The target of response {silent[0]} does not move in the control band; give it a target, or the weight 0."
        )
    return 1.0 / level if model.response_weight is None else model.response_weight
