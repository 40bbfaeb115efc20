"""Levels of the drives: scaled exactly, and refused if they exceed a channel's limits."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from duralab_proto.v1 import array_pb2
from duralab_settings import LevelKind, SettingsError
from identifier.layout import Layout


def scale_to_levels(
    drive: NDArray[np.float64], *, layout: Layout, levels: Sequence[float], level_kind: LevelKind
) -> None:
    """Scale each drive to its level, in place, with one factor each: `S_uu` stays diagonal."""
    if level_kind is LevelKind.PEAK:
        present = np.max(np.abs(drive), axis=1)
    else:
        energy, samples = np.zeros(drive.shape[0]), 0
        for capture in layout.captures:
            used = drive[:, capture.start : capture.start + layout.samples_of(capture)]
            energy += np.einsum("ij,ij->i", used, used)
            samples += used.shape[1]
        present = np.sqrt(energy / samples)
    drive *= (np.asarray(levels, dtype=np.float64) / present)[:, None]


def check_levels(
    drive: NDArray[np.float64],
    *,
    channels: Sequence[array_pb2.Channel],
    levels: Sequence[float],
    sample_rate: float,
    level_kind: LevelKind = LevelKind.RMS,
) -> None:
    """Refuse a drive that would exceed a limit of its channel, before it is played.

    Parameters
    ----------
    drive
        Shape (drives, samples), each row in its channel's unit.
    channels
        Drives in order, with minimum, maximum and, if stated, the slew limit.
    levels
        Level of each drive, in its unit.
    sample_rate
        Sample rate in hertz.
    level_kind
        Kind of the levels.

    Raises
    ------
    SettingsError
        Drives exceed their limits; names every such drive with its peak, the limit and the level that would fit.
    """
    article, name = ("an", "RMS") if level_kind is LevelKind.RMS else ("a", "peak")
    offences = []
    for row, channel, level in zip(drive, channels, levels, strict=True):
        peak, limit, unit = _furthest(row, channel, sample_rate)
        excess = _excess(peak, limit)
        if excess > 1.0:
            fitting = _round_down(level / excess)
            offences.append(
                f"{channel.name} would reach {peak:.4g} {unit} beyond its limit of {limit:g} {unit} "
                + (f"({article} {name} of {fitting:g} {channel.unit} fits)" if fitting > 0.0 else f"(no {name} fits)")
            )
    if offences:
        raise SettingsError(
            f"The excitation is too large: {'; '.join(offences)}.", field=f"excitation.{level_kind.value}"
        )


def largest_excess(
    drive: NDArray[np.float64], *, channels: Sequence[array_pb2.Channel], sample_rate: float
) -> tuple[float, str]:
    """Return the largest ratio of a drive to one of its limits, and the name of that channel.

    `drive`: Shape (drives, samples), each row in its channel's unit. `channels`: Drives in order. `sample_rate`: Hz.
    Returns: Above 1 if the drive exceeds a limit, infinite if a limit leaves no room; the channel's name.
    """
    ratios = [_excess(*_furthest(row, channel, sample_rate)[:2]) for row, channel in zip(drive, channels, strict=True)]
    worst = int(np.argmax(ratios))
    return ratios[worst], channels[worst].name


def _furthest(row: NDArray[np.float64], channel: array_pb2.Channel, sample_rate: float) -> tuple[float, float, str]:
    """Return the peak of a drive that comes furthest in its limit, that limit, and their unit."""
    reaches = [
        (float(row.max()), channel.maximum, channel.unit),
        (float(row.min()), channel.minimum, channel.unit),
    ]
    if channel.slew_limit > 0.0 and row.size > 1:
        fastest = float(np.max(np.abs(np.diff(row)))) * sample_rate
        reaches.append((fastest, channel.slew_limit, f"{channel.unit}/s"))
    return max(reaches, key=lambda reach: _excess(reach[0], reach[1]))


def _excess(peak: float, limit: float) -> float:
    """Return the ratio of peak to limit in that direction; infinite if the limit leaves no room."""
    if peak == 0.0:
        return 0.0
    return peak / limit if peak * limit > 0.0 else np.inf if limit == 0.0 else 0.0


def _round_down(value: float) -> float:
    """Return the value rounded down to three significant digits."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return float(np.floor(value / unit) * unit)
