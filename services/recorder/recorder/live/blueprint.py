"""Layout of the live view: tabs with a plot for each channel, titled with its unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import AbsoluteTimeRange

from duralab_proto.v1 import array_pb2
from recorder.live.charts import CANVAS
from recorder.live.rig import RIG, RIG_NOW
from recorder.live.scene import Outline
from recorder.live.series import RUN_TIME, Group, channel_path, with_unit

STATUS: Final = "campaign/status"
"""Document with the phase and the error table."""

LOG: Final = "campaign/log"
"""Document with every change of phase and activity and its time, the newest first."""

ERROR: Final = "error"
"""Bars per channel and iteration; the same figures are on the timeline `iteration`."""

RMS_RESPONSE: Final = "rms_response"
"""Bars and timeline of the ratio of the response's RMS to the target's, as for `ERROR`."""

FRF: Final = "frf"
"""Drawing of the identified FRF and its coherence."""

_EYE: Final = np.array([-1.15, -0.95, 0.8])
"""Position of the camera behind, right of and above the centre, in radii of the outline."""

_NEARER: Final = 0.7
"""Factor of the camera's distance in a panel three times as wide as high: rigs are wide."""


@dataclass(frozen=True)
class Stage:
    """Subject of a campaign for the layout.

    `campaign`: Its name. `drives`, `responses`: In the rig's order. `detail`: Start and end of the segment that the
    first tab magnifies, in seconds. `duration`: Length of the target, in seconds. `outline`: Outline of the rig; None
    if the rig has no shapes. `watched`: Whether a viewer is connected during the campaign.
    """

    campaign: str
    drives: Sequence[array_pb2.Channel]
    responses: Sequence[array_pb2.Channel]
    detail: tuple[float, float]
    duration: float
    outline: Outline | None = None
    watched: bool = False


def _rig_view(origin: str, outline: Outline, *, name: str, distance: float = 1.0) -> rrb.Spatial3DView:
    eye = outline.centre + distance * _EYE * outline.radius
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=outline.centre, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(visible=False),
    )


def _rig_tab(outline: Outline, *, watched: bool) -> rrb.Horizontal:
    replay = _rig_view(RIG, outline, name="Rig in the newest playback, at the time below")
    views = [_rig_view(RIG_NOW, outline, name="Rig now"), replay] if watched else [replay]
    status = rrb.TextDocumentView(origin=STATUS, name="Campaign")
    return rrb.Horizontal(rrb.Vertical(*views), status, column_shares=[5, 2], name="Rig")


def _shown(start: rrb.TimeRangeBoundary, end: rrb.TimeRangeBoundary) -> rrb.TimeAxis:
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _from_to(start: float, end: float) -> rrb.TimeAxis:
    """Return the axis of a fixed segment in seconds; relative bounds would move with the time cursor."""
    return _shown(rrb.TimeRangeBoundary.absolute(seconds=start), rrb.TimeRangeBoundary.absolute(seconds=end))


def _plots(
    group: Group,
    channels: Sequence[array_pb2.Channel],
    *,
    name: str,
    axis: rrb.TimeAxis,
    legend: bool = True,
) -> rrb.Grid:
    return rrb.Grid(
        *(
            rrb.TimeSeriesView(
                origin=channel_path(group, channel.name),
                name=with_unit(channel),
                axis_x=axis,
                # One legend is enough for the colours; it lists every playback and hides a quarter of its plot.
                plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend and place == 0),
            )
            for place, channel in enumerate(channels)
        ),
        grid_columns=max(1, math.ceil(math.sqrt(len(channels)))),
        name=name,
    )


def _bars(origin: str, *, name: str, legend: bool) -> rrb.BarChartView:
    return rrb.BarChartView(
        origin=origin,
        name=name,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )


def make_blueprint(stage: Stage) -> rrb.Blueprint:
    """Lay out the live view of a campaign."""
    start, end = stage.detail
    whole = _from_to(0.0, stage.duration)
    everything = _shown(rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.infinite())
    rig, rig_tab = [], []
    if stage.outline is not None:
        rig = [_rig_view(RIG_NOW if stage.watched else RIG, stage.outline, name="Rig", distance=_NEARER)]
        rig_tab = [_rig_tab(stage.outline, watched=stage.watched)]
    on_target = rrb.Horizontal(
        # The text beside it explains the colours.
        _plots(Group.RESPONSE, stage.responses, name="Response on target", axis=_from_to(start, end), legend=False),
        rrb.Vertical(
            *rig,
            _bars(ERROR, name="Relative RMS error [%], one group for each iteration", legend=True),
            _bars(RMS_RESPONSE, name="RMS response / target [%], one group for each iteration", legend=False),
            rrb.TextDocumentView(origin=STATUS, name="Campaign"),
            row_shares=[*([5] * len(rig)), 7, 3, 10],
        ),
        column_shares=[5, 2],
        name=f"On target? (in band, {start:.1f} to {end:.1f} s)",
    )
    return rrb.Blueprint(
        rrb.Tabs(
            on_target,
            *rig_tab,
            _plots(Group.RESPONSE, stage.responses, name="Whole run (in band)", axis=whole),
            _plots(Group.DRIVE, stage.drives, name="Drives and their limits", axis=whole),
            # An identification takes longer than the target: show the whole range.
            _plots(Group.MEASURED, stage.responses, name="As measured (while it plays)", axis=everything),
            rrb.Spatial2DView(
                origin=FRF,
                name="FRF and coherence",
                visual_bounds=rrb.VisualBounds2D(x_range=(0.0, CANVAS[0]), y_range=(0.0, CANVAS[1])),
            ),
            rrb.TextDocumentView(origin=LOG, name="Log"),
            active_tab=0,
            name=stage.campaign,
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # The newest playback repeats in real time: the rig moves without a click.
        rrb.TimePanel(
            state="collapsed",
            timeline=RUN_TIME,
            play_state="playing",
            loop_mode="selection",
            time_selection=AbsoluteTimeRange(0, round(stage.duration * 1e9)),
        ),
        auto_layout=False,
        auto_views=False,
    )
