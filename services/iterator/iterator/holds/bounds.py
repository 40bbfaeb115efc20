"""Conditions under which a campaign waits before a playback."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from duralab_settings import HoldPoint, HoldSettings, StopCriteria
from iterator.assessment import BoundedQuantity, Forecast, passed_bound

_WORDS: Final = {BoundedQuantity.PEAK: "peak", BoundedQuantity.DAMAGE: "damage"}


def hold_reason(
    hold: HoldSettings, *, is_first: bool, forecast: Forecast, stop: StopCriteria, level: float, names: Sequence[str]
) -> str:
    """Return why a campaign waits before a playback, one sentence without a full stop; empty if it plays at once.

    `is_first`: Whether the campaign has made no playback yet. `forecast`: Forecast of the playback. `stop`: Criteria
    with the damage exponent. `level`: Share of the target that is played; bounds are relative to the whole target.
    `names`: Names of the controlled responses.
    """
    match hold.when:
        case HoldPoint.FIRST if is_first:
            return "The campaign waits before its first playback"
        case HoldPoint.EACH:
            return "The campaign waits before each playback"
        case HoldPoint.PREDICTED:
            bounds = {"error_bound": None, "peak_bound": hold.predicted_peak, "damage_bound": hold.predicted_damage}
            passed = passed_bound(forecast.metrics, stop.model_copy(update=bounds), level=level)
            if passed is not None:
                words = _WORDS[passed.quantity]
                return (
                    f"The predicted {words} of {names[passed.response]} is {passed.value:.3g} of the target's, past "
                    f"hold.predicted_{words} of {passed.bound:g}"
                )
    return ""
