"""Description of a rig."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from html import escape
from typing import Final

import numpy as np

from duralab.data.sensor import Sensor
from duralab.data.signals import Channel, channels_of
from duralab.display import html_table, text_table
from duralab_proto.arrays import from_array
from duralab_proto.channels import overdue_calibrations
from duralab_proto.v1 import rig_pb2

_RIG: Final = ("", "channel", "limits", "rate limit", "what it is")

SENSOR_COLUMNS: Final = (
    *("channel", "serial number", "sensitivity", "calibrated", "due", "range", "polarity", "warning", "abort"),
    "calculated from",
)
"""Headings of the table of sensors."""

_RIGS: Final = ("rig", "specimen", "engine", "drives", "responses", "sample rate")


@dataclass(frozen=True, eq=False)
class Rig:
    """Description of a rig and its limits.

    Parameters
    ----------
    name : str
        Name of the rig, as in its keys.
    specimen, engine, version : str
        Mounted specimen, name of the engine that plays, and version of its software.
    sample_rate : float
        Only sample rate that the rig plays, in hertz.
    drives, responses : tuple of Channel
        Commanded and measured channels, in the order of the rows of a drive and a response.
    longest_drive_seconds : float
        Longest drive that the rig plays.
    static_response : np.ndarray, shape (responses)
        Value of each response at rest, in its unit.
    content_hash : str
        SHA-256 of all settings that determine its response to a drive.
    publishes_after_run : bool
        Whether its signal blocks are published only after a run.
    cannot_be_stopped : bool
        Whether a begun run always continues to its end; a stop latches the rig nevertheless.
    simulated : bool
        Whether the rig is a simulation; on any other rig a campaign waits before its first playback by default.
    """

    name: str
    specimen: str
    engine: str
    version: str
    sample_rate: float
    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    longest_drive_seconds: float
    static_response: np.ndarray
    content_hash: str
    publishes_after_run: bool = False
    cannot_be_stopped: bool = False
    simulated: bool = False

    @property
    def overdue(self) -> tuple[str, ...]:
        """Sensors whose calibration is overdue today, one sentence each."""
        return tuple(overdue_calibrations((one.to_message() for one in self.responses), today=date.today()))

    @classmethod
    def from_message(cls, message: rig_pb2.RigDescription) -> Rig:
        """Decode a description."""
        return cls(
            name=message.rig,
            specimen=message.specimen,
            engine=message.engine,
            version=message.version,
            sample_rate=message.sample_rate,
            drives=channels_of(message.drives),
            responses=channels_of(message.responses),
            longest_drive_seconds=message.longest_drive_seconds,
            static_response=from_array(
                message.static_response, field="static_response", shape=(len(message.responses),)
            ),
            content_hash=message.content_hash,
            publishes_after_run=message.publishes_after_run,
            cannot_be_stopped=message.cannot_be_stopped,
            simulated=message.simulated,
        )

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Rig({self.name}: {len(self.drives)} drives, {len(self.responses)} responses, {self.sample_rate:g} Hz)"

    def __str__(self) -> str:
        """Return the rig's channels and limits as a table."""
        return rig_text(self)

    def _repr_html_(self) -> str:

        return rig_html(self)


class Rigs(tuple[Rig, ...]):
    """Rigs of a lab, by name; prints as a table."""

    __slots__ = ()

    def __str__(self) -> str:
        """Return one line for each rig."""
        return rigs_text(self)

    def _repr_html_(self) -> str:

        return rigs_html(self)


def limits_in_words(channel: Channel) -> str:
    """Return the allowed range of a channel, e.g. "± 0.1 m"."""
    if not np.isfinite([channel.minimum, channel.maximum]).all():
        return "–"
    if channel.minimum == -channel.maximum:
        return f"± {channel.maximum:g} {channel.unit}"
    return f"{channel.minimum:g} … {channel.maximum:g} {channel.unit}"


def _rig_rows(rig: Rig) -> list[tuple[str, ...]]:
    rows = []
    for kind, channels in (("drive", rig.drives), ("response", rig.responses)):
        for channel in channels:
            slew = f"{channel.slew_limit:g} {channel.unit}/s" if channel.slew_limit else "–"
            rows.append((kind, channel.name, limits_in_words(channel), slew, channel.label))
    return rows


def _rig_title(rig: Rig) -> str:
    return (
        f"{rig.name}: {rig.specimen}; {rig.sample_rate:g} Hz, drives up to {rig.longest_drive_seconds:g} s, engine "
        f"{rig.engine} {rig.version}"
    )


def rig_text(rig: Rig) -> str:
    """Return a rig's channels and sensors as text."""
    rows = sensor_rows(rig.responses)
    sensors = f"\n{text_table(SENSOR_COLUMNS, rows, left=len(SENSOR_COLUMNS))}" if rows else ""
    channels = text_table(_RIG, _rig_rows(rig), left=len(_RIG))
    return "\n".join([f"{_rig_title(rig)}\n{channels}{sensors}", *rig.overdue])


def rig_html(rig: Rig) -> str:
    """Return a rig's channels and sensors as HTML."""
    rows = sensor_rows(rig.responses)
    sensors = html_table(SENSOR_COLUMNS, rows, left=len(SENSOR_COLUMNS)) if rows else ""
    overdue = "".join(f"<p>{escape(sentence)}</p>" for sentence in rig.overdue)
    return html_table(_RIG, _rig_rows(rig), left=len(_RIG), caption=_rig_title(rig)) + sensors + overdue


def sensor_rows(channels: Iterable[Channel]) -> list[tuple[str, ...]]:
    """Return the table of sensors and calculated channels; empty if no channel has either.

    `channels`: Responses of a rig.
    Returns: Rows with the columns of `SENSOR_COLUMNS`.
    """
    rows = []
    for channel in channels:
        sensor = channel.sensor or Sensor()
        if channel.sensor is None and not channel.calculated:
            continue
        ranged = sensor.minimum or sensor.maximum
        rows.append(
            (
                channel.name,
                sensor.serial_number or "–",
                f"{sensor.sensitivity:g} {sensor.sensitivity_unit}" if sensor.sensitivity else "–",
                sensor.calibration_date or "–",
                sensor.calibration_due or "–",
                f"{sensor.minimum:g} … {sensor.maximum:g} {channel.unit}" if ranged else "–",
                {1: "positive", -1: "negative"}.get(sensor.polarity, "–")
                + (f" to {sensor.drive}" * bool(sensor.drive)),
                f"{sensor.warning_level:g} {channel.unit}" if sensor.warning_level else "–",
                f"{sensor.abort_level:g} {channel.unit}" if sensor.abort_level else "–",
                " + ".join(f"{weight:g} × {name}" for name, weight in channel.calculated) or "–",
            )
        )
    return rows


def _rigs_rows(rigs: Sequence[Rig]) -> list[tuple[str, ...]]:
    return [
        (rig.name, rig.specimen, rig.engine, str(len(rig.drives)), str(len(rig.responses)), f"{rig.sample_rate:g} Hz")
        for rig in rigs
    ]


def rigs_text(rigs: Sequence[Rig]) -> str:
    """Return a line for each rig."""
    return text_table(_RIGS, _rigs_rows(rigs), left=3) if rigs else "There is no rig in this lab."


def rigs_html(rigs: Sequence[Rig]) -> str:
    """Return the same as HTML."""
    return html_table(_RIGS, _rigs_rows(rigs), left=3) if rigs else "<p>There is no rig in this lab.</p>"
