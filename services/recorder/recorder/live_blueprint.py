"""What the viewer shows without a click: tabs with a plot for each channel, titled with its unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from duralab_proto.v1 import array_pb2
from recorder.live_charts import CANVAS
from recorder.live_series import RUN_TIME, Group, channel_path, with_unit

STATUS: Final = "campaign/status"
"""Document: the phase and the error table."""

LOG: Final = "campaign/log"
"""Document: every change of phase and activity with its time, the newest first."""

ERROR: Final = "error"
"""Bars per channel and iteration, and the same figures on the timeline `iteration`."""

RMS_RESPONSE: Final = "rms_response"
"""Likewise for the ratio of the response's RMS to the target's."""

FRF: Final = "frf"
"""Drawing: the identified FRF and its coherence."""


@dataclass(frozen=True)
class Stage:
    """What a campaign is about, as far as the layout needs it.

    Parameters
    ----------
    campaign : str
        Its name.
    drives, responses : sequence of array_pb2.Channel
        In the rig's order.
    detail : tuple of float
        Start and end of the stretch that the first tab shows magnified, in seconds.
    """

    campaign: str
    drives: Sequence[array_pb2.Channel]
    responses: Sequence[array_pb2.Channel]
    detail: tuple[float, float]


def _plots(
    group: Group, channels: Sequence[array_pb2.Channel], *, name: str, detail: tuple[float, float] | None = None
) -> rrb.Grid:
    axis = None
    if detail is not None:
        axis = rrb.TimeAxis(
            view_range=rr.TimeRange(
                start=rrb.TimeRangeBoundary.absolute(seconds=detail[0]),
                end=rrb.TimeRangeBoundary.absolute(seconds=detail[1]),
            )
        )
    return rrb.Grid(
        *(
            rrb.TimeSeriesView(
                origin=channel_path(group, channel.name),
                name=with_unit(channel),
                axis_x=axis,
                # One legend is enough where the plots are small; in the other tabs each has its own, to click on.
                plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=detail is None or place == 0),
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
    """Lay out the live view of a campaign.

    Parameters
    ----------
    stage : Stage
        The campaign's channels.

    Returns
    -------
    rrb.Blueprint
        Tabs: the target against the response at the target's peak with the error of each iteration beside it; the
        whole run; drives; signals as measured while they play; the FRF; the log. The panels for experts are folded.
    """
    start, end = stage.detail
    on_target = rrb.Horizontal(
        _plots(Group.RESPONSE, stage.responses, name="Response on target", detail=stage.detail),
        rrb.Vertical(
            _bars(ERROR, name="Relative RMS error [%], one group for each iteration", legend=True),
            _bars(RMS_RESPONSE, name="RMS response / target [%], one group for each iteration", legend=False),
            rrb.TextDocumentView(origin=STATUS, name="Campaign"),
            row_shares=[3, 2, 3],
        ),
        column_shares=[5, 2],
        name=f"On target? (in band, {start:.1f} to {end:.1f} s)",
    )
    return rrb.Blueprint(
        rrb.Tabs(
            on_target,
            _plots(Group.RESPONSE, stage.responses, name="Whole run (in band)"),
            _plots(Group.DRIVE, stage.drives, name="Drives"),
            _plots(Group.MEASURED, stage.responses, name="As measured (while it plays)"),
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
        rrb.TimePanel(state="collapsed", timeline=RUN_TIME, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )
