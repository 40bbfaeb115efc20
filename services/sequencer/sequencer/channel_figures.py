"""Figures of each response of a running endurance test: damage over plan, and the residual of the last repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, Literal

import numpy as np

from duralab_proto.arrays import from_array
from duralab_proto.v1 import sequencer_pb2


def damage_ratio(status: sequencer_pb2.EnduranceStatus) -> Mapping[str, float]:
    """Return the counted damage of each response over the planned damage of the played part; empty if unknown."""
    return _over_planned(status, "damage")


def correction_damage_ratio(status: sequencer_pb2.EnduranceStatus) -> Mapping[str, float]:
    """Return the part of corrections of drives in `damage_ratio`; empty if the planned damage is unknown."""
    return _over_planned(status, "correction_damage")


def _over_planned(
    status: sequencer_pb2.EnduranceStatus, field: Literal["damage", "correction_damage"]
) -> Mapping[str, float]:
    if not (status.HasField(field) and status.HasField("damage_planned_so_far")):
        return {}
    counted, planned = (
        from_array(array, field="damage", shape=(len(status.responses),))
        for array in (getattr(status, field), status.damage_planned_so_far)
    )
    pairs = zip(status.responses, counted, planned, strict=True)
    return {name: float(damage / plan) for name, damage, plan in pairs if plan > 0.0}


def residual(status: sequencer_pb2.EnduranceStatus) -> Mapping[str, float]:
    """Return the residual of each response in the last repeat, all bands together, as a share of its RMS."""
    if not status.HasField("last_statistics"):
        return {}
    shape = (len(status.responses), len(status.columns))
    table = from_array(status.last_statistics, field="last_statistics", shape=shape, finite=False)
    parts = table[:, [column for column, name in enumerate(status.columns) if name.startswith("residual")]]
    values = np.sqrt(np.sum(parts**2, axis=1))
    return {name: float(value) for name, value in zip(status.responses, values, strict=True) if np.isfinite(value)}


CHANNEL_FIGURES: Final[Mapping[str, tuple[str, Callable[[sequencer_pb2.EnduranceStatus], Mapping[str, float]]]]] = {
    "damage_ratio": (
        "Damage of a response, that of corrections included, over the planned damage of the repeats played",
        damage_ratio,
    ),
    "correction_damage_ratio": (
        "Damage of the playbacks that corrected drives over the planned damage of the repeats played",
        correction_damage_ratio,
    ),
    "residual": ("Residual of a response against its baseline in the last repeat, as a share of its RMS", residual),
}
"""Description of each figure and its function of a status, by the end of the figure's name."""
