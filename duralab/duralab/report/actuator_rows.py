"""Use of the actuators and their limits, formatted for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from duralab.data import ActuatorUse, Channel, Signals
from duralab.report.held_drives import HeldStretch, Limit, largest_speed


@dataclass(frozen=True)
class ActuatorRow:
    """Use of one actuator in the best playback; a dash for values that the rig does not have or report.

    `speed_percent` is None if no speed limit is stated.
    """

    title: str
    limit: str
    peak_percent: float
    speed_percent: float | None
    saturated: str
    load_pressure: str
    supply_pressure: str
    following_error: str


def actuator_rows(uses: Sequence[ActuatorUse], drive: Signals) -> list[ActuatorRow]:
    """Return the use of each actuator by a drive."""
    rows = {channel.name: row for row, channel in enumerate(drive.channels)}
    return [
        ActuatorRow(
            title=use.drive.replace("_", " "),
            limit=_limits(drive.channels[rows[use.drive]]),
            peak_percent=100 * use.peak_command_ratio,
            speed_percent=_speed_percent(drive, rows[use.drive]),
            saturated=f"{100 * use.saturated_share:.2f} %" if use.tells_of_a_valve else "–",
            load_pressure=f"{100 * use.largest_load_pressure_share:.0f} %" if use.largest_load_pressure_share else "–",
            supply_pressure=f"{use.lowest_supply_pressure / 1e5:.0f} bar" if use.lowest_supply_pressure else "–",
            following_error=(
                _length(use.largest_following_error, drive.channels[rows[use.drive]].unit)
                if use.tells_what_was_achieved
                else "–"
            ),
        )
        for use in uses
        if use.drive in rows
    ]


@dataclass(frozen=True)
class HeldRow:
    """Printed period in which a drive is at a limit."""

    drive: str
    limit: str
    when: str
    held: str


def held_rows(stretches: Sequence[HeldStretch], drives: Sequence[Channel]) -> list[HeldRow]:
    """Return the periods in which a drive is at a limit."""
    channels = {channel.name: channel for channel in drives}
    return [
        HeldRow(
            drive=channels[stretch.drive].title,
            limit=(
                f"travel, {_limits(channels[stretch.drive])}"
                if stretch.limit is Limit.TRAVEL
                else f"speed, {channels[stretch.drive].slew_limit:.3g} {channels[stretch.drive].unit}/s"
            ),
            when=f"{stretch.start:.2f} to {stretch.end:.2f} s",
            held=f"{1000 * stretch.held_seconds:.0f} ms",
        )
        for stretch in stretches
    ]


def _speed_percent(drive: Signals, row: int) -> float | None:
    limit = drive.channels[row].slew_limit
    return 100 * largest_speed(drive.samples[row], drive.sample_rate) / limit if limit > 0.0 else None


def _limits(channel: Channel) -> str:
    if channel.minimum == -channel.maximum:
        return f"± {_length(channel.maximum, channel.unit)}"
    return f"{_length(channel.minimum, channel.unit)} to {_length(channel.maximum, channel.unit)}"


def _length(value: float, unit: str) -> str:
    return f"{value * 1000:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"
