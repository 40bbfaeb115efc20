"""Damage that a campaign spends on the specimen, by its identification and by its playbacks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duralab_bus import FaultError
from duralab_loads import DAMAGE_EXPONENTS
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import identifier_pb2, query_pb2
from iterator.assessment import IterationMetrics, Outcome, damage_spent
from iterator.campaign.plan import CampaignPlan


def identification_damage(model: identifier_pb2.Model, *, plan: CampaignPlan) -> NDArray[np.float64] | None:
    """Return the damage of the identification in passes of the target.

    Response and target are both counted as measured, the response over the whole run, as the specimen is loaded.

    `model`: As received, untrusted. `plan`: Plan of the campaign.
    Returns: Shape (n_y, exponents), NaN for a response with a silent target; 0 with a model of an earlier
    identification, which is not made again; None if the model does not state the damage of its record.
    Raises `FaultError`: DATA_LOSS if it is damaged.
    """
    if plan.spec.known.HasField("model"):
        return np.where(plan.target_damage > 0.0, 0.0, np.nan)
    if not model.HasField("response_damage"):
        return None
    shape = (len(plan.target_in_band), len(DAMAGE_EXPONENTS))
    try:
        damage = from_array(model.response_damage, field="response_damage", shape=shape, dtype=np.float64)
        if np.any(damage < 0.0):
            raise ArrayError(f"the damage {damage.min():g} must be 0 or more", field="response_damage")
    except ArrayError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"The identifier answered a damaged model: {error}",
            field=error.field,
        ) from error
    target = plan.target_damage
    return np.divide(damage, target, out=np.full(shape, np.nan), where=target > 0.0)


def identification_remarks(damage: NDArray[np.float64] | None, *, plan: CampaignPlan) -> list[str]:
    """Return a remark on the identification's damage in the most loaded controlled response."""
    if damage is None:
        return [
            "The model does not state the damage of its identification, as one of an older recording: damage spent and "
            "stop.damage_budget count the playbacks only."
        ]
    row, value = _most(damage[:, _column(plan)], plan)
    # For a linear rig whose levels all change by one factor.
    advice = f"; at {value ** (-1.0 / _exponent(plan)):.2g} times its levels it does one pass" if value > 1.0 else ""
    return [
        f"The identification did {_passes(value)} the target's damage (k = {_exponent(plan)}) in "
        f"{plan.description.responses[row].name}, the most of any controlled response{advice}."
    ]


def require_budget(damage: NDArray[np.float64] | None, *, plan: CampaignPlan) -> None:
    """Refuse the first playback if the identification left no room for it in the damage budget.

    `damage`: From `identification_damage`. `plan`: Plan of the campaign.
    Raises `FaultError`: FAILED_PRECONDITION if one more pass at the first level would exceed the budget.
    """
    budget = plan.settings.stop.damage_budget
    if damage is None or budget == 0.0:
        return
    level = plan.settings.levels[0] if plan.settings.levels else 1.0
    row, value = _most(damage[:, _column(plan)], plan)
    if value + level ** _exponent(plan) > budget:
        name = plan.description.responses[row].name
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The identification did {_passes(value)} the target's damage (k = {_exponent(plan)}) in {name}, which "
            f"leaves no room for a playback in stop.damage_budget of {budget:g}; identify at lower levels or allow "
            "more.",
            field="stop.damage_budget",
        )


def budget_remarks(outcome: Outcome | None, metrics: tuple[IterationMetrics, ...], *, plan: CampaignPlan) -> list[str]:
    """Return a remark on the spent damage if the damage budget ended the iteration."""
    if outcome is not Outcome.DAMAGE_BUDGET_USED:
        return []
    spent = damage_spent(metrics, exponent=_exponent(plan))
    row, value = _most(spent, plan)
    before = metrics[-1].identification_damage
    share = "" if before is None else f", {before[row, _column(plan)]:.3g} of them by the identification"
    return [
        f"Damage budget: {plan.description.responses[row].name} has taken {_passes(value)} the target's damage (k = "
        f"{_exponent(plan)}){share}; one more playback would exceed stop.damage_budget of "
        f"{plan.settings.stop.damage_budget:g}."
    ]


def _most(damage: NDArray[np.float64], plan: CampaignPlan) -> tuple[int, float]:
    """Return the controlled response with the most damage, and its damage."""
    row = int(np.argmax(np.where(plan.response_weight > 0.0, damage, -np.inf)))
    return row, float(damage[row])


def _exponent(plan: CampaignPlan) -> int:
    return int(plan.settings.stop.damage_exponent)


def _column(plan: CampaignPlan) -> int:
    return DAMAGE_EXPONENTS.index(float(_exponent(plan)))


def _passes(damage: float) -> str:
    """Return damage as a multiple with three digits, without an exponent: 112000, not 1.12e+05."""
    return f"{float(f'{damage:.3g}'):,.12g} times"
