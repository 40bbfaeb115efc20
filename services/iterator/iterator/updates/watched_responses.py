"""Monitored responses: measured and reported, but neither controlled nor used for acceptance and end."""

from __future__ import annotations

from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from iterator.model import ModelUncertainty, RigModel
from iterator.updates.settings import UpdateSettings


def controlled_responses(model: RigModel) -> NDArray[np.bool_]:
    """Return the mask of controlled responses: all except those of weight 0.

    `model`: Model with the weights.
    Returns: Mask, shape (n_y,), False for a monitored response.
    """
    if model.response_weight is None:
        return np.ones(model.frf.shape[1], dtype=bool)
    return model.response_weight > 0.0


def controlled_model(model: RigModel, controlled: NDArray[np.bool_]) -> RigModel:
    """Return the model of the controlled responses only.

    A full correction would otherwise use a monitored response to correct a controlled one.

    `model`: Model of all responses; monitored ones have no part in its inverse. `controlled`, shape (n_y,): From
    `controlled_responses`.
    Returns: The same object if all are controlled.
    """
    if controlled.all():
        return model
    weight, uncertainty = model.response_weight, model.uncertainty
    identified, terms = model.identified_frf, model.term_frf
    return replace(
        model,
        frf=np.ascontiguousarray(model.frf[:, controlled]),
        inverse_frf=np.ascontiguousarray(model.inverse_frf[:, :, controlled]),
        response_weight=None if weight is None else weight[controlled],
        uncertainty=None
        if uncertainty is None
        else ModelUncertainty(
            residual_psd=np.ascontiguousarray(uncertainty.residual_psd[:, controlled]),
            row_covariance=uncertainty.row_covariance,
        ),
        identified_frf=None if identified is None else np.ascontiguousarray(identified[:, controlled]),
        term_frf=None if terms is None else np.ascontiguousarray(terms[:, controlled]),
        earlier=tuple(
            tuple(replace(playback, response=np.ascontiguousarray(playback.response[controlled])) for playback in line)
            for line in model.earlier
        ),
    )


def whole_model(model: RigModel, *, identified: RigModel, controlled: NDArray[np.bool_]) -> RigModel:
    """Return the model of all responses: those that an update corrected, and the monitored ones as identified.

    `model`: Model of the controlled responses. `identified`: Model of all responses, before the first update.
    `controlled`, shape (n_y,): From `controlled_responses`.
    Returns: Model whose inverse does not use monitored responses; `model` itself if all are controlled.
    """
    if controlled.all():
        return model
    frf, inverse = identified.frf.copy(), np.zeros_like(identified.inverse_frf)
    frf[:, controlled], inverse[:, :, controlled] = model.frf, model.inverse_frf
    anchor = None if model.identified_frf is None else identified.frf
    term_frf = None
    if model.term_frf is not None:
        term_frf = np.zeros((*identified.frf.shape[:2], model.term_frf.shape[2]), dtype=np.complex128)
        term_frf[:, controlled] = model.term_frf
    return replace(
        identified,
        frf=frf,
        inverse_frf=inverse,
        identified_frf=anchor,
        terms=model.terms,
        term_frf=term_frf,
        rate_limits=model.rate_limits,
    )


def controlled_settings(settings: UpdateSettings, controlled: NDArray[np.bool_]) -> UpdateSettings:
    """Return the settings of the controlled responses only.

    `settings`: Settings with a gain for every response. `controlled`, shape (n_y,): From `controlled_responses`.
    Returns: The same object if all are controlled.
    Raises `ValueError`: The settings are for another number of responses.
    """
    if settings.gains.size != controlled.size:
        raise ValueError(
            f"There are {settings.gains.size} iteration gains for {controlled.size} responses; give one each."
        )
    if controlled.all():
        return settings

    def kept(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(compress(values, controlled))

    share = settings.gain_curve_share
    return settings.model_copy(
        update={
            "iteration_gain": kept(settings.iteration_gain),
            "gain_curve_share": None if share is None else tuple(kept(row) for row in share),
            "weights": None,
        }
    )
