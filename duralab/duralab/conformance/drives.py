"""Drives for a conformance check: a gentle one, and bad ones of which each must be refused for one reason."""

from __future__ import annotations

import numpy as np

from duralab_proto.v1 import array_pb2, rig_pb2

#: Share of each channel's limits and slew limit that a played drive uses at most.
GENTLE = 0.05
_FREQUENCY = 1.0


def gentle_drive(description: rig_pb2.RigDescription, seconds: float) -> np.ndarray:
    """Return a smooth drive that begins and ends at zero, on all channels together."""
    rate = description.sample_rate
    time = np.arange(round(seconds * rate)) / rate
    envelope = np.sin(np.pi * time / seconds) ** 2
    both_ways = envelope * np.sin(2.0 * np.pi * _FREQUENCY * time)
    rows = []
    for channel in description.drives:
        one_sided = channel.minimum == 0.0 or channel.maximum == 0.0
        reach = channel.maximum if channel.maximum > 0.0 else channel.minimum
        size = reach if one_sided else min(channel.maximum, -channel.minimum)
        row = GENTLE * size * (envelope if one_sided else both_ways)
        fastest = float(np.max(np.abs(np.diff(row, prepend=0.0)))) * rate
        if channel.slew_limit > 0.0 and fastest > GENTLE * channel.slew_limit:
            row *= GENTLE * channel.slew_limit / fastest
        rows.append(row)
    return np.array(rows)


def beyond_limit(description: rig_pb2.RigDescription) -> np.ndarray:
    """Return a drive whose first channel goes smoothly to 2 % beyond its maximum, (drives, samples)."""
    channel, rate = description.drives[0], description.sample_rate
    wanted = 1.02 * channel.maximum if channel.maximum > 0.0 else 0.02 * -channel.minimum
    # A raised cosine of height h in T s moves at pi h / (2 T) at most: half the slew limit, or a second.
    seconds = np.pi * wanted / channel.slew_limit if channel.slew_limit > 0.0 else 1.0
    drive = np.zeros((len(description.drives), max(round(seconds * rate), 10)))
    drive[0] = 0.5 * wanted * (1.0 - np.cos(np.linspace(0.0, np.pi, drive.shape[1])))
    return drive


def jump(description: rig_pb2.RigDescription) -> np.ndarray | None:
    """Return a drive with one step a little faster than allowed, (drives, samples); None where no channel has a limit.

    It stays within 10 % of the channel's limits, on the first channel where that is possible.
    """
    rate = description.sample_rate
    for index, channel in enumerate(description.drives):
        step = 1.05 * channel.slew_limit / rate
        if channel.slew_limit > 0.0 and step <= 0.1 * channel.maximum:
            drive = np.zeros((len(description.drives), 100))
            drive[index, 50:] = step
            return drive
    return None


def copied(channels: list[array_pb2.Channel]) -> list[array_pb2.Channel]:
    """Return copies of channels, to be changed."""
    copies = []
    for channel in channels:
        copy = array_pb2.Channel()
        copy.CopyFrom(channel)
        copies.append(copy)
    return copies
