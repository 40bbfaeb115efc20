"""The live view of one recording: what is committed and played, drawn in Rerun while it happens."""

from __future__ import annotations

import os
import re
import socket
from collections import deque
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import numpy as np
import structlog

# Rerun has no setting in its API against usage reports; this variable is how it is told, before it is imported.
os.environ.setdefault("CI", "1")

import rerun as rr
from google.protobuf.message import Message

from duralab_proto.arrays import from_array, from_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2, rig_pb2
from recorder.live_blueprint import ERROR, FRF, LOG, RMS_RESPONSE, STATUS, Stage, make_blueprint
from recorder.live_charts import Drawing, draw_frf
from recorder.live_series import ITERATION, RUN_TIME, TARGET, Curve, Group, Look, colour_of, with_unit
from recorder.live_tables import status_document, status_line
from recorder.live_thinning import bucket_samples, keep_extremes

APPLICATION: Final = "duralab"
DETAIL_SECONDS: Final = 2.0
"""Length of the stretch around the target's peak that the first tab magnifies: single waves are told apart."""

BATCH_SECONDS: Final = 0.5
"""Signal blocks are drawn in pieces of this length: a hundred samples at a time cost ten times as much."""

FLUSH_SECONDS: Final = 5.0
"""Longest wait for the file (and a viewer) to take what is left, when a recording is closed."""

LOG_LINES: Final = 100
"""Lines of the campaign's log that are shown, the newest first."""

PROBE_SECONDS: Final = 0.5
"""Longest wait for a sign that a viewer listens."""

DEFAULT_PORT: Final = 9876
"""Where a Rerun viewer listens when nothing else is said."""


class LiveView:
    """What the viewer shows of one recording. Not for several threads at once.

    Parameters
    ----------
    recording : str
        Id of the recording.
    file : Path, optional
        Where everything shown is kept; nothing may be there yet.
    viewer : str, optional
        Address of a running viewer, e.g. "rerun+http://127.0.0.1:9876/proxy". Where nobody listens there, the view
        goes on without it.
    """

    def __init__(self, recording: str, *, file: Path | None, viewer: str | None) -> None:
        self._recording = recording
        self._stream = rr.RecordingStream(APPLICATION, recording_id=recording)
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if file is not None:
            sinks.append(rr.FileSink(file))
        # Rerun would keep everything for a viewer that is not there and wait for it at every turn.
        if viewer is not None and _listens(viewer):
            sinks.append(rr.GrpcSink(viewer))
        self._stream.set_sinks(*sinks)
        self._stream.send_recording_name(recording)
        self._specification: iterator_pb2.CampaignSpec | None = None
        self._description: rig_pb2.RigDescription | None = None
        self._status: iterator_pb2.CampaignStatus | None = None
        self._iterations: list[iterator_pb2.IterationMetrics] = []
        self._playbacks: dict[Group, list[str]] = {group: [] for group in Group}
        self._pending: list[rig_pb2.SignalBlock] = []
        self._log_lines: deque[str] = deque(maxlen=LOG_LINES)

    def show_step(self, message: Message) -> None:
        """Draw a committed step; steps without a picture change nothing."""
        match message:
            case iterator_pb2.CampaignSpec():
                self._specification = message
            case rig_pb2.RigDescription():
                self._description = message
            case iterator_pb2.TargetInBand():
                self._show_target(message)
            case identifier_pb2.Model():
                self._show_model(message)
            case iterator_pb2.IterationStep():
                self._show_iteration(message)
            case iterator_pb2.CampaignStatus():
                self.show_status(message)

    def show_status(self, status: iterator_pb2.CampaignStatus) -> None:
        """Write what the campaign does now."""
        line = status_line(status)
        if self._status is None or line != status_line(self._status):
            self._log_lines.append(f"{datetime.now(UTC):%H:%M:%S} UTC – {line}")
            # A document, not a text log: the viewer hides log lines that are not on the timeline of the signals.
            self._write(LOG, "\n\n".join(reversed(self._log_lines)))
        self._status = status
        self._write_status()

    def show_block(self, block: rig_pb2.SignalBlock) -> None:
        """Draw a block of a playback, together with its neighbours."""
        if self._pending and self._pending[0].run != block.run:
            self._draw_pending()
        self._pending.append(block)
        first = self._pending[0]
        span = (block.first_sample - first.first_sample + block.response.shape[-1]) / block.sample_rate
        if block.last or span >= BATCH_SECONDS or span < 0:
            self._draw_pending()

    def close(self) -> None:
        """Draw what is left and let go of the file and the viewer."""
        self._draw_pending()
        try:
            self._stream.flush(timeout_sec=FLUSH_SECONDS)
        except RuntimeError as error:
            structlog.get_logger("recorder").warning("a viewer does not take the view", why=str(error))
        self._stream.disconnect()

    def _show_target(self, message: iterator_pb2.TargetInBand) -> None:
        if self._specification is None or self._description is None:
            return
        channels, sample_rate, asked = from_record(self._specification.target, field="target")
        target = from_array(message.samples, field="samples", shape=asked.shape, dtype=np.float64)
        stage = Stage(
            campaign=self._recording,
            drives=self._description.drives,
            responses=channels,
            detail=_detail(target, sample_rate),
        )
        self._stream.send_blueprint(make_blueprint(stage))
        for group, samples in ((Group.RESPONSE, target), (Group.MEASURED, asked)):
            for row, channel in enumerate(channels):
                curve = Curve(group, channel.name, TARGET)
                self._stream.log(curve.path, curve.style(Look.TARGET), static=True)
                self._send(curve, samples[row], start=0.0, sample_rate=sample_rate)
        for row, channel in enumerate(channels):
            path = rr.escape_entity_path_part(channel.name)
            for figure in (ERROR, RMS_RESPONSE):
                style = rr.SeriesLines(names=channel.name, colors=colour_of(row), widths=1.5)
                self._stream.log(f"{figure}/{path}", style, static=True)
        self._write_status()

    def _show_model(self, message: identifier_pb2.Model) -> None:
        spectrum = message.excitation.spectrum
        drawing = draw_frf(
            from_array(message.frequency, field="frequency"),
            from_array(message.frf, field="frf", finite=False),
            from_array(message.coherence, field="coherence", finite=False),
            responses=[with_unit(channel) for channel in message.responses],
            drives=[with_unit(channel) for channel in message.drives],
            # Models of older recordings do not tell their band themselves.
            band=(
                message.lowest_frequency or spectrum.lowest_frequency,
                message.highest_frequency or spectrum.highest_frequency,
            ),
        )
        _log_drawing(self._stream, drawing)

    def _show_iteration(self, step: iterator_pb2.IterationStep) -> None:
        channels, sample_rate, measured = from_record(step.response, field="response")
        response = from_array(step.response_in_band, field="response_in_band", shape=measured.shape, dtype=np.float64)
        playback = _iteration_name(step.iteration)
        self._dress(Group.RESPONSE, [channel.name for channel in channels], playback)
        for row, channel in enumerate(channels):
            self._send(Curve(Group.RESPONSE, channel.name, playback), response[row], start=0.0, sample_rate=sample_rate)
        self._iterations.append(step.metrics)
        self._draw_figures()
        self._write_status()

    def _draw_pending(self) -> None:
        blocks, self._pending = self._pending, []
        if not blocks or self._description is None:
            return
        first = blocks[0]
        playback = _playback_name(first.run.removeprefix(f"{self._recording}."))
        start = first.first_sample / first.sample_rate
        for group, channels, field in (
            (Group.DRIVE, self._description.drives, "drive"),
            (Group.MEASURED, self._description.responses, "response"),
        ):
            names = [channel.name for channel in channels]
            self._dress(group, names, playback)
            samples = np.concatenate([from_array(getattr(block, field), field=field) for block in blocks], axis=1)
            for row, name in enumerate(names):
                self._send(Curve(group, name, playback), samples[row], start=start, sample_rate=first.sample_rate)

    def _dress(self, group: Group, channels: Sequence[str], playback: str) -> None:
        """Let the newest playback of a group stand out and hide the one before it, once for each playback."""
        earlier = self._playbacks[group]
        if playback in earlier:
            return
        for channel in channels:
            if earlier:
                # The first response shows how far the iteration has come; other earlier curves would only hide it.
                look = Look.FIRST if len(earlier) == 1 and group is Group.RESPONSE else Look.EARLIER
                curve = Curve(group, channel, earlier[-1])
                self._stream.log(curve.path, curve.style(look), static=True)
            curve = Curve(group, channel, playback)
            self._stream.log(curve.path, curve.style(Look.LATEST), static=True)
        earlier.append(playback)

    def _send(self, curve: Curve, samples: np.ndarray, *, start: float, sample_rate: float) -> None:
        highest = 0.0 if self._specification is None else self._specification.highest_frequency
        kept = keep_extremes(samples, bucket_samples(sample_rate, highest))
        self._stream.send_columns(
            curve.path,
            indexes=[rr.TimeColumn(RUN_TIME, duration=start + kept / sample_rate)],
            columns=rr.Scalars.columns(scalars=samples[kept]),
        )

    def _draw_figures(self) -> None:
        """Draw bars per channel and iteration, and keep the figures on a timeline of their own."""
        names = [channel.channel for channel in self._iterations[-1].channels]
        numbers = np.array([float(metrics.iteration) for metrics in self._iterations])
        bar = 0.8 / max(1, len(names))
        for row, name in enumerate(names):
            # A channel that an iteration does not judge has no bar there.
            of_channel = [next((c for c in m.channels if c.channel == name), None) for m in self._iterations]
            path = rr.escape_entity_path_part(name)
            for figure, field in ((ERROR, "relative_rms_error"), (RMS_RESPONSE, "rms_response")):
                percent = np.array([100 * getattr(c, field) if c is not None else 0.0 for c in of_channel])
                bars = rr.BarChart(
                    percent,
                    abscissa=numbers + (row - (len(names) - 1) / 2) * bar,
                    widths=np.full(len(percent), 0.9 * bar),
                    color=colour_of(row),
                )
                self._stream.log(f"{figure}/{path}", bars, static=True)
                self._stream.send_columns(
                    f"{figure}/{path}",
                    indexes=[rr.TimeColumn(ITERATION, sequence=[int(numbers[-1])])],
                    columns=rr.Scalars.columns(scalars=percent[-1:]),
                )

    def _write_status(self) -> None:
        self._write(STATUS, status_document(self._status, self._iterations))

    def _write(self, path: str, markdown: str) -> None:
        self._stream.log(path, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def _listens(viewer: str) -> bool:
    address = urlsplit(viewer)
    try:
        with socket.create_connection((address.hostname or "", address.port or DEFAULT_PORT), timeout=PROBE_SECONDS):
            return True
    except OSError as error:
        structlog.get_logger("recorder").warning(
            "no viewer listens; the view goes on without", viewer=viewer, why=str(error)
        )
        return False


def _iteration_name(iteration: int) -> str:
    # Two digits, because the viewer sorts by letters.
    return f"iteration {iteration:02d}"


def _playback_name(run: str) -> str:
    """Return the name of a playback for the legend: "i03" of a run's name is an iteration, anything else is kept."""
    match = re.fullmatch(r"i(\d{1,6})", run)
    return run if match is None else _iteration_name(int(match[1]))


def _detail(target: np.ndarray, sample_rate: float) -> tuple[float, float]:
    """Return a stretch of a few seconds around the largest load, each channel scaled by its RMS."""
    duration = target.shape[1] / sample_rate
    if duration <= DETAIL_SECONDS:
        return 0.0, duration
    rms = np.sqrt(np.mean(target**2, axis=1, keepdims=True))
    load = np.max(np.abs(np.divide(target, rms, out=np.zeros_like(target), where=rms > 0)), axis=0)
    start = float(np.argmax(load)) / sample_rate - DETAIL_SECONDS / 2
    start = min(max(start, 0.0), duration - DETAIL_SECONDS)
    return start, start + DETAIL_SECONDS


def _log_drawing(stream: rr.RecordingStream, drawing: Drawing) -> None:
    stream.log(
        f"{FRF}/lines",
        rr.LineStrips2D(drawing.strips, colors=drawing.strip_colours, radii=rr.Radius.ui_points(drawing.strip_widths)),
        static=True,
    )
    stream.log(
        f"{FRF}/labels",
        rr.Points2D(
            drawing.label_places,
            labels=drawing.labels,
            colors=drawing.label_colours,
            radii=rr.Radius.ui_points(0.0),
            show_labels=True,
        ),
        static=True,
    )
