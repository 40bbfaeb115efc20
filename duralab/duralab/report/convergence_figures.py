"""Figures over the playbacks: errors, RMS responses, damage ratios and actuator use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from duralab.data import DAMAGE_SLOPES, ActuatorUse, IterationTable
from duralab.report.drawing import Figure, level_line, level_note, markers, over_playbacks


def error_per_playback(table: IterationTable, *, limit: float | None) -> Figure:
    """Return the figure of the relative RMS error of every channel after every playback."""
    layout = over_playbacks("relative RMS error", table.numbers)
    layout["yaxis"]["rangemode"] = "tozero"
    if limit is not None:
        layout["shapes"] = [level_line(limit)]
        layout["annotations"] = [level_note(limit, f"accepted: {limit:g}")]
    return {"data": _channels(table, table.relative_rms_error), "layout": layout}


def response_per_playback(table: IterationTable) -> Figure:
    """Return the figure of the RMS response of every channel after every playback."""
    return _toward_target(table, table.rms_response, "RMS response")


def damage_per_playback(table: IterationTable, slope: int) -> Figure:
    """Return the figure of the damage ratio of every channel after every playback, for one of `DAMAGE_SLOPES`."""
    figure = _toward_target(table, table.damage_ratio[:, :, DAMAGE_SLOPES.index(slope)], f"damage ratio, k = {slope}")
    figure["layout"]["yaxis"]["type"] = "log"
    # On a logarithmic axis an annotation's position is the logarithm of its value; a line's is the value itself.
    figure["layout"]["annotations"] = [level_note(0.0, "target")]
    return figure


def actuator_use_per_playback(actuators: Sequence[Sequence[ActuatorUse]], numbers: Sequence[int]) -> Figure:
    """Return the figure of every drive's peak over its limit, for every playback."""
    data = [
        markers(i, use.drive, x=numbers, y=np.array([100 * uses[i].peak_command_ratio for uses in actuators]))
        for i, use in enumerate(actuators[0])
    ]
    layout = over_playbacks("peak of the drive [% of its limit]", numbers)
    layout["yaxis"]["range"] = [0, 105]
    layout["shapes"], layout["annotations"] = [level_line(100.0, "@error")], [level_note(100.0, "limit", "@error")]
    return {"data": data, "layout": layout}


def _toward_target(table: IterationTable, values: np.ndarray, title: str) -> Figure:
    layout: dict[str, Any] = over_playbacks(title, table.numbers)
    layout["shapes"], layout["annotations"] = [level_line(1.0)], [level_note(1.0, "target")]
    return {"data": _channels(table, values), "layout": layout}


def _channels(table: IterationTable, values: np.ndarray) -> list[Figure]:
    columns = zip(table.channels, values.T, strict=True)
    return [markers(i, name, x=table.numbers, y=column) for i, (name, column) in enumerate(columns)]
