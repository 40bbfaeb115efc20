"""Values derived from a channel's description: the unit of its kind, and an overdue calibration."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date
from types import MappingProxyType
from typing import Final

from duralab_proto.v1 import array_pb2

UNIT_OF_KIND: Final = MappingProxyType(
    {
        array_pb2.CHANNEL_KIND_DISPLACEMENT: "m",
        array_pb2.CHANNEL_KIND_FORCE: "N",
        array_pb2.CHANNEL_KIND_MOMENT: "N*m",
        array_pb2.CHANNEL_KIND_ACCELERATION: "m/s^2",
        array_pb2.CHANNEL_KIND_PRESSURE: "Pa",
        array_pb2.CHANNEL_KIND_RATIO: "1",
        array_pb2.CHANNEL_KIND_VELOCITY: "m/s",
        array_pb2.CHANNEL_KIND_STRAIN: "1",
        array_pb2.CHANNEL_KIND_ANGLE: "rad",
        array_pb2.CHANNEL_KIND_VOLTAGE: "V",
        array_pb2.CHANNEL_KIND_CURRENT: "A",
    }
)
"""SI unit of each kind of channel; a channel without a kind has none."""


def overdue_calibrations(channels: Iterable[array_pb2.Channel], *, today: date) -> list[str]:
    """Return a sentence for each sensor whose calibration is overdue.

    Parameters
    ----------
    channels : iterable of array_pb2.Channel
        Channels of a rig; those without a sensor or a due date give no sentence.
    today : date
        Present date.

    Returns
    -------
    list of str
        Sentences in the order of the channels, with channel, serial number and days. A due date that is not a date is
        reported too, because it may be overdue.
    """
    sentences = []
    for channel in channels:
        sensor = channel.sensor
        if not sensor.calibration_due:
            continue
        which = f" ({sensor.serial_number})" if sensor.serial_number else ""
        try:
            days = (today - date.fromisoformat(sensor.calibration_due)).days
        except ValueError:
            sentences.append(
                f"The calibration of {channel.name}{which} is due {sensor.calibration_due[:40]!r}, which is no date; "
                "correct the description of the rig: YYYY-MM-DD."
            )
            continue
        if days >= 0:
            sentences.append(
                f"The calibration of {channel.name}{which} is overdue since {sensor.calibration_due}, for {days} days; "
                "calibrate the sensor, or take its figures with care."
            )
    return sentences
