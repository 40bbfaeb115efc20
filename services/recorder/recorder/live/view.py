"""Live view of one recording: committed steps and playbacks, drawn in Rerun during the campaign."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import structlog
from google.protobuf.message import Message

from duralab_proto.arrays import ArrayError, from_array, from_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2, rig_pb2
from duralab_recordings import response_in_band
from recorder.live.blueprint import FRF, LOG, STATUS, Stage, make_blueprint
from recorder.live.charts import Drawing
from recorder.live.endurance import EnduranceDrawing, EnduranceStep
from recorder.live.figures import draw_figures, dress_figures
from recorder.live.frf import draw_frf
from recorder.live.limits import DriveLimits
from recorder.live.pieces import Piece
from recorder.live.playbacks import Playback, iteration, playback_of
from recorder.live.rig import RigDrawing
from recorder.live.scene import read_scene
from recorder.live.series import RUN_TIME, TARGET, Curve, Group, Look, with_unit
from recorder.live.stream import close_stream, open_stream, send_blueprint
from recorder.live.tables import reset_line, state_line, status_document, status_line
from recorder.live.thinning import bucket_samples, keep_extremes

DETAIL_SECONDS: Final = 2.0
"""Length of the segment around the target's peak that the first tab magnifies: single waves are visible."""

LONGEST_PIECE_SECONDS: Final = 30.0
"""Longest segment of signals drawn at once, also if they arrive faster: some megabytes."""

LOG_LINES: Final = 100
"""Number of lines of the campaign's log that are shown, the newest first."""


class LiveView:
    """Live view of one recording. Not safe for threads.

    Parameters
    ----------
    recording : str
        Id of the recording.
    file : Path, optional
        File for everything shown; an existing one is replaced.
    viewer : str, optional
        Address of a running viewer, e.g. "rerun+http://127.0.0.1:9876/proxy". If no viewer listens there, the view
        continues without it.
    """

    def __init__(self, recording: str, *, file: Path | None, viewer: str | None) -> None:
        self._recording = recording
        opened = open_stream(recording, file=file, viewer=viewer)
        self._stream, self._watched = opened.stream, opened.watched
        self._target: np.ndarray | None = None
        self._specification: iterator_pb2.CampaignSpec | None = None
        self._description: rig_pb2.RigDescription | None = None
        self._status: iterator_pb2.CampaignStatus | None = None
        self._iterations: list[iterator_pb2.IterationMetrics] = []
        self._playbacks: dict[Group, list[Playback]] = {group: [] for group in Group}
        self._pending: Piece[rig_pb2.SignalBlock] = Piece()
        self._log_lines: deque[str] = deque(maxlen=LOG_LINES)
        self._state: rig_pb2.RigState | None = None
        self._rig: RigDrawing | None = None
        self._limits: DriveLimits | None = None
        self._endurance = EnduranceDrawing(self._stream)

    def show_step(self, message: Message) -> None:
        """Draw a committed step after all earlier data; other steps change nothing."""
        self._draw_pending()
        match message:
            case iterator_pb2.CampaignSpec():
                self._specification = message
            case rig_pb2.RigDescription():
                self._show_rig(message)
            case iterator_pb2.TargetInBand():
                self._show_target(message)
            case identifier_pb2.Model():
                self._show_model(message)
            case iterator_pb2.IterationStep():
                self._show_iteration(message)
            case iterator_pb2.CampaignStatus():
                self.show_status(message)
            case _ if isinstance(message, EnduranceStep):
                self._endurance.show(message)

    def show_status(self, status: iterator_pb2.CampaignStatus, *, at: datetime | None = None) -> None:
        """Write the current activity of the campaign; `at` is its time, the present if not given."""
        line = status_line(status)
        if self._status is None or line != status_line(self._status):
            self._note(line, at)
        self._status = status
        self._write_status()

    def show_state(self, state: rig_pb2.RigState, *, at: datetime | None = None) -> None:
        """Write the state of the rig, first of all a latched interlock and its reason; `at` as for `show_status`."""
        before = self._state or rig_pb2.RigState()
        reset = reset_line(state) if reset_line(state) != reset_line(before) else ""
        if reset or (state.mode, state.reason, state.run) != (before.mode, before.reason, before.run):
            self._note(state_line(state) + (f" ({reset})" if reset else ""), at)
        self._state = state
        self._write_status()

    def show_pose(self, block: rig_pb2.PoseBlock) -> None:
        """Move the rig; poses of playbacks of the target's drive stay on the timeline, the newest over the others."""
        if self._rig is not None:
            self._rig.show(block, on_run_time=playback_of(block.run, recording=self._recording).is_iteration)

    def show_block(self, block: rig_pb2.SignalBlock) -> None:
        """Draw a block of a playback, together with its neighbours; an endurance test shows trends instead."""
        if self._endurance.begun:
            return
        last = self._pending.last
        if last is not None and (last.run != block.run or last.first_sample > block.first_sample):
            self._draw_pending()
        self._pending.add(block)
        first = self._pending.first or block
        span = (block.first_sample - first.first_sample + block.response.shape[-1]) / block.sample_rate
        if block.last or span >= LONGEST_PIECE_SECONDS or self._pending.due:
            self._draw_pending()

    def close(self) -> bool:
        """Draw the remaining data, release the file and the viewer, and return whether they accepted everything."""
        self._draw_pending()
        self._endurance.draw()
        return close_stream(self._stream)

    def _show_rig(self, description: rig_pb2.RigDescription) -> None:
        self._description = description
        self._limits = DriveLimits(self._stream, description.drives)
        self._endurance.show_rig(description)
        try:
            scene = read_scene(description)
        except ArrayError as error:
            structlog.get_logger("recorder").warning("the rig cannot be drawn", rig=description.rig, why=str(error))
            return
        if scene is not None:
            self._rig = RigDrawing(self._stream, scene, now=self._watched)

    def _note(self, line: str, at: datetime | None) -> None:
        moment = at if at is not None else datetime.now(UTC)
        self._log_lines.append(f"{moment:%H:%M:%S} UTC – {line}")
        # A document, not a text log: the viewer hides log lines that are not on the timeline of the signals.
        self._write(LOG, "\n\n".join(reversed(self._log_lines)))

    def _show_target(self, message: iterator_pb2.TargetInBand) -> None:
        if self._specification is None or self._description is None:
            return
        channels, sample_rate, asked = from_record(self._specification.target, field="target")
        target = from_array(message.samples, field="samples", shape=asked.shape, dtype=np.float64)
        self._target = target
        stage = Stage(
            campaign=self._recording,
            drives=self._description.drives,
            responses=channels,
            detail=_detail(target, sample_rate),
            duration=target.shape[1] / sample_rate,
            outline=None if self._rig is None else self._rig.outline,
            watched=self._watched,
        )
        send_blueprint(self._stream, make_blueprint(stage))
        for group, samples in ((Group.RESPONSE, target), (Group.MEASURED, asked)):
            for row, channel in enumerate(channels):
                curve = Curve(group, channel.name, TARGET)
                self._stream.log(curve.path, curve.style(Look.TARGET), static=True)
                self._send(curve, samples[row], start=0.0, sample_rate=sample_rate)
        dress_figures(self._stream, [channel.name for channel in channels])
        self._write_status()

    def _show_model(self, message: identifier_pb2.Model) -> None:
        spectrum = message.excitation.spectrum
        drawing = draw_frf(
            from_array(message.frequency, field="frequency"),
            from_array(message.frf, field="frf", finite=False),
            from_array(message.coherence, field="coherence", finite=False),
            responses=[with_unit(channel) for channel in message.responses],
            drives=[with_unit(channel) for channel in message.drives],
            drive_ranges=[channel.maximum - channel.minimum for channel in message.drives],
            # Models of older recordings do not state their band.
            band=(
                message.lowest_frequency or spectrum.lowest_frequency,
                message.highest_frequency or spectrum.highest_frequency,
            ),
        )
        _log_drawing(self._stream, drawing)

    def _show_iteration(self, step: iterator_pb2.IterationStep) -> None:
        if self._iterations and step.iteration <= self._iterations[-1].iteration:
            # A view that begins while its recording is written gets a step twice: from the log and from the stream.
            return
        if self._description is not None and (response := self._judged(step)) is not None:
            channels, sample_rate = self._description.responses, self._description.sample_rate
            playback = self._played(step)
            self._dress(Group.RESPONSE, [channel.name for channel in channels], playback)
            for row, channel in enumerate(channels):
                curve = Curve(Group.RESPONSE, channel.name, playback)
                self._send(curve, response[row], start=0.0, sample_rate=sample_rate)
        self._iterations.append(step.metrics)
        draw_figures(self._stream, self._iterations)
        self._write_status()

    def _judged(self, step: iterator_pb2.IterationStep) -> np.ndarray | None:
        """Return the response in the control band; None where the target that its error refers to was not shown."""
        if self._target is not None:
            return response_in_band(step, self._target)
        if step.HasField("error_in_band"):
            return None
        return from_array(step.response_in_band, field="response_in_band", shape=(None, None), dtype=np.float64)

    def _played(self, step: iterator_pb2.IterationStep) -> Playback:
        """Return the attempt of a step, so that its response is drawn beside its measured one."""
        own = iteration(step.iteration)
        playback = playback_of(step.run, recording=self._recording)
        # A step of a resumed campaign may name a run of another recording.
        return playback if playback.name == own.name else own

    def _draw_pending(self) -> None:
        if self._rig is not None:
            self._rig.catch_up()
        blocks = self._pending.take()
        if not blocks or self._description is None:
            return
        first = blocks[0]
        playback = playback_of(first.run, recording=self._recording)
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
            if group is Group.DRIVE and self._limits is not None:
                self._limits.reach(start + samples.shape[1] / first.sample_rate)

    def _dress(self, group: Group, channels: Sequence[str], playback: Playback) -> None:
        """Highlight the newest playback of a group and hide the one before it, once for each playback."""
        earlier = self._playbacks[group]
        if playback in earlier:
            return
        for channel in channels:
            if earlier:
                # The first response shows the progress of the iteration; other earlier curves would only hide it.
                look = Look.FIRST if len(earlier) == 1 and group is Group.RESPONSE else Look.EARLIER
                if playback.repeats(earlier[-1]):
                    look = Look.REPEATED
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

    def _write_status(self) -> None:
        asked = 0.0 if self._specification is None else self._specification.stop.damage_exponent
        document = status_document(self._status, self._iterations, state=self._state, exponent=asked or 5.0)
        self._write(STATUS, document)

    def _write(self, path: str, markdown: str) -> None:
        self._stream.log(path, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def _detail(target: np.ndarray, sample_rate: float) -> tuple[float, float]:
    """Return a segment of a few seconds around the largest load, each channel scaled by its RMS."""
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
