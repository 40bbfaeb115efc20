"""Figures of an endurance test: damage against the plan, trends with limits and alarms, samples around an alarm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from duralab.analysis import damage_so_far
from duralab.data import Signals
from duralab.recording import EnduranceRecording
from duralab.report.drawing import Figure, axes, channel_color, level_line, level_note, line
from duralab.report.series import encode
from duralab_monitoring import Levels
from duralab_proto.v1 import sequencer_pb2
from duralab_spectra import piece_extremes

MOST_POINTS: Final = 2000
"""Maximum number of points of a curve over the repeats; a longer one is drawn as its envelope."""

WINDOW_SECONDS: Final = 2.0
"""Length of the window of samples around an alarm, centred on the largest difference."""


def damage_over_plan(recording: EnduranceRecording, planned: np.ndarray) -> Figure:
    """Return the damage counted after every repeat, as a share of `planned`, shape (responses,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 100.0 * damage_so_far(recording) / planned
    curves = [
        line(name.replace("_", " "), channel_color(row), **_over_repeats(recording.repeats.repeat, share[:, row]))
        for row, name in enumerate(recording.responses)
        if np.isfinite(planned[row])
    ]
    total = recording.schedule.total_repeats
    even = line("even over the schedule", "@muted", dash="dash", x=[0, total], y=[0, 100])
    layout = axes(x="repeat", y="damage [%]", shapes=[level_line(100.0)])
    return {"data": [*curves, even], "layout": layout}


def trend(recording: EnduranceRecording, deviation: np.ndarray, row: int, *, levels: Levels) -> Figure:
    """Return one statistic of a response over the repeats, a curve for each event, with limits and alarms.

    `deviation`, shape (repeats,): Deviation as a share of the baseline.
    """
    figure = _per_event(recording, 100.0 * deviation, "deviation [% of the baseline]")
    figure["layout"]["shapes"] += [
        level_line(sign * 100.0 * level, color)
        for level, color in ((levels.warning, "@muted"), (levels.abort, "@error"))
        for sign in (1.0, -1.0)
    ]
    figure["layout"]["annotations"] = [
        level_note(100.0 * levels.warning, "warning"),
        level_note(100.0 * levels.abort, "abort", "@error"),
    ]
    figure["layout"]["shapes"] += _alarm_lines(recording, row)
    return figure


def residual(recording: EnduranceRecording, row: int, columns: Sequence[int]) -> Figure:
    """Return the residual of a response against its baseline in each band, over the repeats."""
    repeats = recording.repeats
    curves = [
        line(
            recording.columns[column].removeprefix("residual "),
            channel_color(place),
            **_over_repeats(repeats.repeat, 100.0 * repeats.statistics[:, row, column]),
        )
        for place, column in enumerate(columns)
    ]
    layout = axes(x="repeat", y="residual [% of the RMS]", shapes=_alarm_lines(recording, row))
    return {"data": curves, "layout": layout}


def around_alarm(response: Signals, reference: Signals, row: int, *, names: tuple[str, str]) -> Figure:
    """Return the response of a repeat and that of an early one, around their largest difference."""
    samples = min(response.samples.shape[1], reference.samples.shape[1])
    ours, theirs = response.samples[row, :samples], reference.samples[row, :samples]
    half = max(1, int(0.5 * WINDOW_SECONDS * response.sample_rate))
    centre = int(np.argmax(np.abs(ours - theirs)))
    first = max(0, min(centre - half, samples - 2 * half))
    window = slice(first, min(samples, first + 2 * half))
    grid: dict[str, Any] = {"x0": first / response.sample_rate, "dx": 1.0 / response.sample_rate}
    channel = response.channels[row]
    return {
        "data": [
            line(names[1], "@target", y=encode(theirs[window]), **grid),
            line(names[0], "@best", y=encode(ours[window]), **grid),
        ],
        "layout": axes(x="time [s]", y=f"{channel.title} [{channel.unit}]"),
    }


def _per_event(recording: EnduranceRecording, values: np.ndarray, title: str) -> Figure:
    repeats = recording.repeats
    curves = []
    for number, name in enumerate(recording.schedule.events):
        rows = np.flatnonzero((repeats.event == number) & repeats.known)
        curves.append(line(name, channel_color(number), **_over_repeats(repeats.repeat[rows], values[rows])))
    return {"data": curves, "layout": axes(x="repeat", y=title, shapes=[])}


def _over_repeats(repeat: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    """Return a curve for plotly.js; a long one as the smallest and largest value of each piece."""
    known = np.isfinite(values)
    repeat, values = repeat[known], values[known]
    if values.size > MOST_POINTS:
        shown = piece_extremes(np.ascontiguousarray(values, dtype=np.float64), -(-values.size // (MOST_POINTS // 2)))
        repeat, values = repeat[shown].ravel(), values[shown].ravel()
    return {"x": encode(repeat), "y": encode(values)}


def _alarm_lines(recording: EnduranceRecording, row: int) -> list[Figure]:
    """Return a line at each alarm of a response."""
    name = recording.responses[row]
    colors = {sequencer_pb2.ALARM_LEVEL_WARNING: "@muted", sequencer_pb2.ALARM_LEVEL_ABORT: "@error"}
    return [
        {
            "type": "line",
            "x0": alarm.repeat,
            "x1": alarm.repeat,
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "line": {"color": colors.get(alarm.level, "@muted"), "width": 1, "dash": "dot"},
        }
        for alarm in recording.alarms
        if alarm.channel == name
    ]
