"""Forecast of a playback, and its error after the playback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.assessment.metrics import IterationMetrics, judge_response
from iterator.band import ControlBand
from iterator.model import IterationHistory, RigModel, equivalent_drive, predict


@dataclass(frozen=True)
class Forecast:
    """Prediction of the controlled responses of one playback, made before the playback.

    Parameters
    ----------
    response : ndarray, shape (n_y, samples)
        Predicted response in the control band, divided by the level, response units: the last response plus the
        model's response to the change of the drive.
    metrics : IterationMetrics
        Figures of the predicted response.
    uncertainty : ndarray, shape (n_y,)
        RMS of the predicted uncertainty of `response`, over the target's RMS: the last forecast's error, reduced
        for a smaller step; before the first playback the part of the model's record that the model does not
        explain. NaN if the model does not state that.
    step : ndarray, shape (n_y,)
        RMS of the predicted change, over the target's RMS.
    missed : ndarray, shape (n_y,), optional
        RMS of the difference to the playback, over the target's RMS; None before the playback.
    """

    response: NDArray[np.float64]
    metrics: IterationMetrics
    uncertainty: NDArray[np.float64]
    step: NDArray[np.float64]
    missed: NDArray[np.float64] | None = None

    def compared(self, response: NDArray[np.float64], *, target: NDArray[np.float64]) -> Forecast:
        """Return the forecast with its error compared with the playback."""
        return replace(self, missed=rms(response - self.response) / rms(target))


def forecast_playback(
    drive: NDArray[np.float64],
    model: RigModel,
    history: IterationHistory,
    *,
    band: ControlBand,
    level: float,
    earlier: Sequence[Forecast],
) -> Forecast:
    """Predict the controlled responses to a drive.

    `drive`, shape (n_u, samples): Output of the drive map if there is one, divided by its level. `model`: Model that
    the drive was made with. `history`: Playbacks before it. `level`: Share of the target that is played. `earlier`:
    Forecasts of the earlier playbacks, compared with them.
    """
    target = rms(history.target)
    last = history.last
    if last is None:
        predicted = predict(model, drive, band=band)
        uncertainty = _unexplained(model) / level / target
        change = predicted
    else:
        moved, moved_before = (
            equivalent_drive(each, model.rate_limits, sample_rate=band.sample_rate) for each in (drive, last.drive)
        )
        change = predict(model, moved - moved_before, band=band)
        predicted = last.response + change
        uncertainty = np.full(target.size, np.nan)
    step = rms(change) / target
    if earlier and earlier[-1].missed is not None:
        share = np.divide(step, earlier[-1].step, out=np.ones_like(step), where=earlier[-1].step > 0.0)
        uncertainty = earlier[-1].missed * np.minimum(1.0, share)
    return Forecast(predicted, judge_response(history.target, predicted, level=level), uncertainty, step)


def _unexplained(model: RigModel) -> NDArray[np.float64]:
    """Return the RMS of the part of each response in the model's own record that the model does not explain."""
    if model.uncertainty is None:
        return np.full(model.frf.shape[1], np.nan)
    spacing = float(model.frequency[1] - model.frequency[0])
    return np.sqrt(spacing * np.sum(model.uncertainty.residual_psd[model.identified], axis=0))
