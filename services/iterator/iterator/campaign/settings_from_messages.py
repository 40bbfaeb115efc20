"""The update, the stop criteria and the limit policy of a specification, checked and put into the core's settings."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, query_pb2
from iterator.assessment import BoundedQuantity, DamageBounds, PlaybackBounds, StopCriteria
from iterator.band import ControlBand
from iterator.limits import LimitPolicy
from iterator.model import checked_response_weight
from iterator.updates import (
    AcceptanceSettings,
    CorrectionSettings,
    CorrectionShape,
    GainCurve,
    Prediction,
    SecantSettings,
    UpdateKind,
    UpdateSettings,
    require_shares,
)
from labbus import FaultError

_UPDATE_KINDS: Final = {
    iterator_pb2.UPDATE_KIND_BASIC_TWR: UpdateKind.BASIC_TWR,
    iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING: UpdateKind.ADAPTIVE_MODELLING,
    iterator_pb2.UPDATE_KIND_SECANT: UpdateKind.SECANT,
}
_LIMIT_POLICIES: Final = {
    iterator_pb2.LIMIT_POLICY_UNSPECIFIED: LimitPolicy.REFUSE,
    iterator_pb2.LIMIT_POLICY_REFUSE: LimitPolicy.REFUSE,
    iterator_pb2.LIMIT_POLICY_PROJECT: LimitPolicy.PROJECT,
}
_PREDICTIONS: Final = {
    iterator_pb2.CORRECTION_PREDICTION_UNSPECIFIED: Prediction.FORWARD,
    iterator_pb2.CORRECTION_PREDICTION_FORWARD: Prediction.FORWARD,
    iterator_pb2.CORRECTION_PREDICTION_BACKWARD: Prediction.BACKWARD,
}
_SHAPES: Final = {
    iterator_pb2.CORRECTION_SHAPE_UNSPECIFIED: CorrectionShape.DIAGONAL,
    iterator_pb2.CORRECTION_SHAPE_DIAGONAL: CorrectionShape.DIAGONAL,
    iterator_pb2.CORRECTION_SHAPE_FULL: CorrectionShape.FULL,
}
# What the contract says that 0 stands for.
_DAMAGE_EXPONENT: Final = 5.0
_IMPROVEMENT_PLAYBACKS: Final = 2
_BOUNDS: Final = tuple(quantity.value for quantity in BoundedQuantity)


def invalid(message: str, *, field: str) -> FaultError:
    """Return the fault for a value of a specification that is not allowed."""
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)


def checked_update(update: iterator_pb2.UpdateSettings, band: ControlBand, *, responses: int) -> UpdateSettings:
    """Return the update's settings of the core.

    Parameters
    ----------
    update : UpdateSettings
        As received; nothing in it is trusted.
    band : ControlBand
        Of the campaign.
    responses : int
        How many the rig has.

    Returns
    -------
    UpdateSettings
        Checked.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT with the field.
    """
    kind = _UPDATE_KINDS.get(update.kind)
    if kind is None:
        offered = ", ".join(f"{known.name} ({number})" for number, known in _UPDATE_KINDS.items())
        raise invalid(f"The kind of update is {update.kind}; offered are {offered}.", field="update.kind")
    gain = from_array(update.iteration_gain, field="update.iteration_gain", shape=(None,), dtype=np.float64)
    if gain.size != responses:
        raise invalid(
            f"The update has {gain.size} iteration gains; each of the {responses} responses needs one.",
            field="update.iteration_gain",
        )
    correction, secant = CorrectionSettings(), SecantSettings()
    if kind is UpdateKind.ADAPTIVE_MODELLING:
        correction = _checked_correction(update)
    if kind is UpdateKind.SECANT and update.HasField("secant"):
        try:
            secant = SecantSettings(
                forgetting=update.secant.forgetting,
                prior_strength=update.secant.prior_strength,
                caution=update.secant.caution,
                regularisation=update.secant.regularisation,
            )
        except ValueError as error:
            raise invalid(str(error), field="update.secant") from error
    try:
        require_shares(gain, what="iteration gain of response")
    except ValueError as error:
        raise invalid(str(error), field="update.iteration_gain") from error
    curve = _checked_curve(update, responses=responses)
    try:
        return UpdateSettings(
            band=band,
            iteration_gain=gain,
            kind=kind,
            correction=correction,
            secant=secant,
            acceptance=AcceptanceSettings() if update.accept_segments else None,
            gain_schedule=tuple(update.gain_schedule) or (1.0,),
            gain_curve=curve,
        )
    except ValueError as error:
        raise invalid(str(error), field="update.gain_schedule") from error


def _checked_correction(update: iterator_pb2.UpdateSettings) -> CorrectionSettings:
    for field, value, offered in (
        ("prediction", update.prediction, _PREDICTIONS),
        ("shape", update.shape, _SHAPES),
    ):
        if value not in offered:
            raise invalid(
                f"The correction's {field} is {value}; offered are 0 to {max(offered)}.", field=f"update.{field}"
            )
    try:
        return CorrectionSettings(
            smallest=update.smallest_correction,
            largest=update.largest_correction,
            weigh_by_coherence=update.weigh_by_coherence,
            lowest_coherence=update.lowest_coherence,
            prediction=_PREDICTIONS[update.prediction],
            shape=_SHAPES[update.shape],
        )
    except ValueError as error:
        raise invalid(str(error), field="update.smallest_correction") from error


def _checked_curve(update: iterator_pb2.UpdateSettings, *, responses: int) -> GainCurve | None:
    given = update.HasField("gain_curve_frequency"), update.HasField("gain_curve_share")
    if not any(given):
        return None
    if not all(given):
        raise invalid(
            "The gain curve has only one of its frequencies and its shares; give both or none.",
            field="update.gain_curve_frequency",
        )
    frequency = from_array(
        update.gain_curve_frequency, field="update.gain_curve_frequency", shape=(None,), dtype=np.float64
    )
    share = from_array(
        update.gain_curve_share, field="update.gain_curve_share", shape=(frequency.size, responses), dtype=np.float64
    )
    try:
        return GainCurve(frequency=frequency, share=share)
    except ValueError as error:
        raise invalid(str(error), field="update.gain_curve_share") from error


def checked_weight(update: iterator_pb2.UpdateSettings, *, responses: int, drives: int) -> NDArray[np.float64]:
    """Return how much each response counts beside the others.

    Parameters
    ----------
    update : UpdateSettings
        As received; nothing in it is trusted.
    responses, drives : int
        How many the rig has.

    Returns
    -------
    ndarray, shape (responses,)
        0 for a response that is watched; all 1 where the update names none.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT: too few responses would be controlled, or a weight is negative.
    ArrayError
        Another number of weights, or one that is not finite.
    """
    if not update.HasField("response_weight"):
        return np.ones(responses)
    given = from_array(update.response_weight, field="update.response_weight", shape=(responses,), dtype=np.float64)
    try:
        return checked_response_weight(given, responses=responses, drives=drives)
    except ValueError as error:
        raise invalid(str(error), field="update.response_weight") from error


def checked_stop(stop: iterator_pb2.StopCriteria) -> StopCriteria:
    """Return the stop criteria of the core.

    Parameters
    ----------
    stop : StopCriteria
        As received; nothing in it is trusted.

    Returns
    -------
    StopCriteria
        Checked.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT with the field.
    """
    exponent = stop.damage_exponent or _DAMAGE_EXPONENT
    try:
        damage = None
        if stop.smallest_damage_ratio or stop.largest_damage_ratio:
            damage = DamageBounds(
                smallest=stop.smallest_damage_ratio, largest=stop.largest_damage_ratio, exponent=exponent
            )
        return StopCriteria(
            largest_iterations=stop.largest_iterations,
            relative_rms_error=stop.relative_rms_error,
            divergence_ratio=stop.divergence_ratio,
            damage=damage,
            smallest_improvement=stop.smallest_improvement,
            improvement_playbacks=stop.improvement_playbacks or _IMPROVEMENT_PLAYBACKS,
            damage_budget=stop.damage_budget,
            damage_budget_exponent=exponent,
            bounds=PlaybackBounds(**{bound: getattr(stop, bound) for bound in _BOUNDS if getattr(stop, bound)}),
        )
    except ValueError as error:
        raise invalid(str(error), field="stop") from error


def checked_limit_policy(policy: iterator_pb2.LimitPolicy) -> LimitPolicy:
    """Return what is done with a drive past a limit; raises FaultError where it is not offered."""
    if policy not in _LIMIT_POLICIES:
        raise invalid(f"The limit policy is {policy}; offered are 0 to {max(_LIMIT_POLICIES)}.", field="limit_policy")
    return _LIMIT_POLICIES[policy]
