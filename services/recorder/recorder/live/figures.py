"""Figures of the iterations in the live view: bars per channel and iteration, on a separate timeline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from duralab_proto.v1 import iterator_pb2
from recorder.live.blueprint import ERROR, RMS_RESPONSE
from recorder.live.series import ITERATION, colour_of


def dress_figures(stream: rr.RecordingStream, channels: Sequence[str]) -> None:
    """Give each channel its name and colour."""
    for row, channel in enumerate(channels):
        for figure in (ERROR, RMS_RESPONSE):
            style = rr.SeriesLines(names=channel, colors=colour_of(row), widths=1.5)
            stream.log(f"{figure}/{rr.escape_entity_path_part(channel)}", style, static=True)


def draw_figures(stream: rr.RecordingStream, iterations: Sequence[iterator_pb2.IterationMetrics]) -> None:
    """Draw bars of all iterations so far, in percent, and add the newest figures to the timeline `iteration`."""
    names = [channel.channel for channel in iterations[-1].channels]
    numbers = np.array([float(metrics.iteration) for metrics in iterations])
    bar = 0.8 / max(1, len(names))
    for row, name in enumerate(names):
        # A channel that an iteration does not judge has no bar for it.
        of_channel = [next((c for c in m.channels if c.channel == name), None) for m in iterations]
        path = rr.escape_entity_path_part(name)
        for figure, field in ((ERROR, "relative_rms_error"), (RMS_RESPONSE, "rms_response")):
            percent = np.array([100 * getattr(c, field) if c is not None else 0.0 for c in of_channel])
            bars = rr.BarChart(
                percent,
                abscissa=numbers + (row - (len(names) - 1) / 2) * bar,
                widths=np.full(len(percent), 0.9 * bar),
                color=colour_of(row),
            )
            stream.log(f"{figure}/{path}", bars, static=True)
            stream.send_columns(
                f"{figure}/{path}",
                indexes=[rr.TimeColumn(ITERATION, sequence=[int(numbers[-1])])],
                columns=rr.Scalars.columns(scalars=percent[-1:]),
            )
