"""Live view of an endurance test: trends over the repeats, damage, alarms and hold points."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from duralab_proto.arrays import from_array
from duralab_proto.v1 import array_pb2, rig_pb2, sequencer_pb2
from recorder.live.blueprint import LOG, STATUS
from recorder.live.pieces import Piece
from recorder.live.series import FIRST_COLOUR, LIMIT_COLOUR, Colour, colour_of, with_unit
from recorder.live.stream import send_blueprint

REPEAT: Final = "repeat"
"""Timeline of the trends: number of the repeat in the schedule, from 0."""

DAMAGE: Final = "damage"
"""Damage counted so far for each channel."""

_RESIDUAL: Final = "residual"
_TRENDS: Final = ("rms", "min", "max", _RESIDUAL)
"""Curves of each channel: columns of the statistics, and the residual of all bands together."""

_TITLES: Final = {
    "rms": "RMS",
    "min": "Minimum",
    "max": "Maximum",
    _RESIDUAL: "Residual against the baseline [% of the RMS]",
}

_LEVELS: Final = {sequencer_pb2.ALARM_LEVEL_WARNING: "warning", sequencer_pb2.ALARM_LEVEL_ABORT: "**abort**"}

ALARMS_LISTED: Final = 100

EnduranceStep = (
    sequencer_pb2.EnduranceSpec
    | sequencer_pb2.EnduranceVolume
    | sequencer_pb2.EnduranceRepeat
    | sequencer_pb2.EnduranceCorrection
    | sequencer_pb2.EnduranceHold
    | sequencer_pb2.EnduranceDecision
    | sequencer_pb2.EnduranceStatus
)
"""Steps that are drawn."""


class EnduranceDrawing:
    """Live view of one recording of an endurance test.

    `stream`: Stream of the view.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._volume: sequencer_pb2.EnduranceVolume | None = None
        self._planned: list[np.ndarray] = []
        self._channels: Sequence[array_pb2.Channel] = ()
        self._damage: np.ndarray | None = None
        self._whole: np.ndarray | None = None
        self._pending: Piece[sequencer_pb2.EnduranceRepeat] = Piece()
        self._last = -1
        self._corrections: set[str] = set()
        self._alarms: deque[sequencer_pb2.EnduranceAlarm] = deque(maxlen=ALARMS_LISTED)
        self._said = ""

    @property
    def begun(self) -> bool:
        """Whether the recording is one of an endurance test."""
        return self._volume is not None

    def show(self, step: EnduranceStep) -> None:
        """Draw a committed step; repeats are collected shortly and drawn together."""
        match step:
            case sequencer_pb2.EnduranceSpec():
                self._planned = [
                    from_array(event.planned_damage, field="planned_damage")
                    for event in step.events
                    if event.HasField("planned_damage")
                ]
            case sequencer_pb2.EnduranceVolume():
                self._volume = step
            case sequencer_pb2.EnduranceRepeat():
                self._take(step)
            case sequencer_pb2.EnduranceCorrection():
                self._count(step)
            case sequencer_pb2.EnduranceHold():
                self._say(f"**Waits before repeat {step.next_repeat}**: {step.reason}")
            case sequencer_pb2.EnduranceDecision():
                self._say("")
            case sequencer_pb2.EnduranceStatus():
                self._say(f"**{step.activity}**" + (f": {step.fault.message}" if step.HasField("fault") else ""))

    def show_rig(self, description: rig_pb2.RigDescription) -> None:
        """Lay out the view for the channels of a rig; without a volume the recording is not an endurance test."""
        if self._volume is None or self._damage is not None:
            return
        self._channels = description.responses
        events, shape = self._volume.events, (len(self._channels),)
        counted = [
            from_array(event.damage, field="damage", shape=shape) for event in events if event.HasField("damage")
        ]
        self._damage = np.sum([np.zeros(shape), *counted], axis=0)
        self._whole = self._whole_damage()
        send_blueprint(self._stream, _blueprint(self._volume.id, self._channels))
        for row, channel in enumerate(self._channels):
            for trend in _TRENDS:
                for number, event in enumerate(events):
                    self._dress(_path(trend, channel.name, event.name), event.name, colour_of(number))
                points = rr.SeriesPoints(names="alarm", colors=LIMIT_COLOUR, markers="circle", marker_sizes=4.0)
                self._stream.log(_path(trend, channel.name, "alarms"), points, static=True)
            self._dress(f"{DAMAGE}/{rr.escape_entity_path_part(channel.name)}", channel.name, colour_of(row))
        self._say("")

    def draw(self) -> None:
        """Draw the collected repeats."""
        repeats = self._pending.take()
        if not repeats or self._volume is None or self._damage is None:
            return
        columns = list(self._volume.columns)
        shape = (len(self._channels), len(columns))
        for number, event in enumerate(self._volume.events):
            mine = [step for step in repeats if step.event == number and step.HasField("statistics")]
            if mine:
                self._draw_trends(event.name, columns, mine, shape)
        self._draw_damage(repeats)
        self._say(self._said)

    def _take(self, step: sequencer_pb2.EnduranceRepeat) -> None:
        if step.repeat <= self._last:
            # A view that begins while its recording is written gets a step twice: from the log and from the stream.
            return
        self._last = step.repeat
        self._alarms.extend(step.alarms)
        self._pending.add(step)
        if self._pending.due or step.alarms:
            self.draw()
        if step.alarms:
            self._list_alarms()

    def _count(self, step: sequencer_pb2.EnduranceCorrection) -> None:
        """Add the damage of a correction; the points of the next repeats show it."""
        if self._damage is None or step.campaign in self._corrections or not step.HasField("damage"):
            return
        self._corrections.add(step.campaign)
        self.draw()
        self._damage = self._damage + from_array(step.damage, field="damage", shape=self._damage.shape)

    def _draw_trends(
        self, event: str, columns: list[str], repeats: list[sequencer_pb2.EnduranceRepeat], shape: tuple[int, int]
    ) -> None:
        numbers = [step.repeat for step in repeats]
        tables = np.array(
            [from_array(step.statistics, field="statistics", shape=shape, finite=False) for step in repeats]
        )
        residual = [place for place, name in enumerate(columns) if name.startswith(_RESIDUAL)]
        drawn = {trend: tables[:, :, columns.index(trend)] for trend in _TRENDS if trend in columns}
        # All bands together: they do not overlap.
        drawn[_RESIDUAL] = 100.0 * np.sqrt(np.sum(tables[:, :, residual] ** 2, axis=2))
        for trend, values in drawn.items():
            for row, channel in enumerate(self._channels):
                self._send(_path(trend, channel.name, event), numbers, values[:, row])
                raised = [
                    place for place, step in enumerate(repeats) if any(a.channel == channel.name for a in step.alarms)
                ]
                if raised:
                    path = _path(trend, channel.name, "alarms")
                    self._send(path, [numbers[place] for place in raised], values[raised, row])

    def _draw_damage(self, repeats: list[sequencer_pb2.EnduranceRepeat]) -> None:
        """Draw the damage after each repeat, as a share of the damage of the whole schedule if that is known."""
        assert self._damage is not None  # of `draw`
        each = np.array(
            [
                from_array(step.damage, field="damage", shape=self._damage.shape)
                if step.HasField("damage")
                else np.zeros_like(self._damage)
                for step in repeats
            ]
        )
        counted = self._damage + np.cumsum(each, axis=0)
        self._damage = counted[-1]
        if self._whole is None:
            return
        numbers = [step.repeat for step in repeats]
        for row, channel in enumerate(self._channels):
            if self._whole[row] > 0.0:
                path = f"{DAMAGE}/{rr.escape_entity_path_part(channel.name)}"
                self._send(path, numbers, 100.0 * counted[:, row] / self._whole[row])

    def _whole_damage(self) -> np.ndarray | None:
        """Return the damage of the whole schedule: as planned, or from the mean of the repeats measured before."""
        assert self._volume is not None  # of `show_rig`
        events = [event for event in self._volume.events if event.planned]
        if self._planned and len(self._planned) == len(self._volume.events):
            pairs = zip(self._volume.events, self._planned, strict=True)
            return np.sum([event.planned * planned for event, planned in pairs], axis=0)
        if any(not event.measured for event in events):
            return None
        return np.sum(
            [event.planned / event.measured * from_array(event.measured_damage, field="damage") for event in events],
            axis=0,
        )

    def _send(self, path: str, repeats: Sequence[int], values: np.ndarray) -> None:
        known = np.isfinite(values)
        if known.any():
            self._stream.send_columns(
                path,
                indexes=[rr.TimeColumn(REPEAT, sequence=np.array(repeats)[known])],
                columns=rr.Scalars.columns(scalars=values[known]),
            )

    def _dress(self, path: str, name: str, colour: Colour = FIRST_COLOUR) -> None:
        self._stream.log(path, rr.SeriesLines(names=name, colors=colour, widths=1.2), static=True)

    def _say(self, said: str) -> None:
        """Write the progress of the test, and why it waits or how it ended."""
        self._said = said
        if self._volume is None:
            return
        total = sum(event.planned for event in self._volume.events)
        lines = [
            f"# Endurance test {self._volume.id} on {self._volume.rig}",
            f"{self._last + 1 if self._last >= 0 else self._volume.first_repeat} of {total} repeats",
            said,
            _alarm_line(self._alarms[-1]) if self._alarms else "No alarm in this recording.",
        ]
        self._write(STATUS, "\n\n".join(line for line in lines if line))

    def _list_alarms(self) -> None:
        self._write(LOG, "\n\n".join(_alarm_line(alarm) for alarm in reversed(self._alarms)))

    def _write(self, path: str, markdown: str) -> None:
        self._stream.log(path, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def _alarm_line(alarm: sequencer_pb2.EnduranceAlarm) -> str:
    return f"Repeat {alarm.repeat}, {_LEVELS.get(alarm.level, 'alarm')}: {alarm.sentence}"


def _path(trend: str, channel: str, curve: str) -> str:
    return f"trend/{trend}/{rr.escape_entity_path_part(channel)}/{rr.escape_entity_path_part(curve)}"


def _blueprint(test: str, channels: Sequence[array_pb2.Channel]) -> rrb.Blueprint:
    """Lay out trends, damage and alarms."""

    def grid(trend: str) -> rrb.Grid:
        return rrb.Grid(
            *(
                rrb.TimeSeriesView(
                    origin=f"trend/{trend}/{rr.escape_entity_path_part(channel.name)}",
                    name=channel.name if trend == _RESIDUAL else with_unit(channel),
                    plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=place == 0),
                )
                for place, channel in enumerate(channels)
            ),
            grid_columns=3,
            name=_TITLES[trend],
        )

    first, *others = (grid(trend) for trend in (_RESIDUAL, "rms", "min", "max"))
    status = rrb.TextDocumentView(origin=STATUS, name="Endurance test")
    alarms = rrb.TextDocumentView(origin=LOG, name="Alarms")
    damage = rrb.TimeSeriesView(origin=DAMAGE, name="Damage [% of the whole schedule]")
    overview = rrb.Horizontal(
        first, rrb.Vertical(status, damage, alarms), column_shares=[5, 2], name="Residual, damage and alarms"
    )
    return rrb.Blueprint(
        rrb.Tabs(overview, *others, active_tab=0, name=test),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=REPEAT),
        auto_layout=False,
        auto_views=False,
    )
