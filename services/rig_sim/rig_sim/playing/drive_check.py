"""Checks of a drive before anything moves: the first sentence that is wrong with it, or nothing."""

from __future__ import annotations

import numpy as np

from rig_sim.playing.playable import PlayableSpecimen
from rig_sim.specimen.specimen import InputChannel


class DriveError(ValueError):
    """A drive that must not be played, in one sentence.

    Parameters
    ----------
    message : str
        What is wrong, in one sentence.

    Attributes
    ----------
    field : str
        Path of the request's field that is wrong.
    """

    def __init__(self, message: str, *, field: str) -> None:
        super().__init__(message)
        self.field = field


def check_drive(
    specimen: PlayableSpecimen, names: list[str], units: list[str], sample_rate: float, drive: np.ndarray
) -> None:
    """Check a drive against the specimen's channels and limits.

    Parameters
    ----------
    specimen : PlayableSpecimen
        Whose drive it is.
    names, units : list of str
        Of the drive's channels, in its order; as many as it has rows.
    sample_rate : float
        In Hz.
    drive : (channels, samples)
        Each row in its channel's unit.

    Raises
    ------
    DriveError
        Where rate, channels, units, length, a value, a limit or a slew rate is not allowed. Every bad channel of the
        first kind of error is named at once.
    """
    if sample_rate != specimen.sample_rate:
        raise DriveError(
            f"the drive's sample rate is {sample_rate:g} Hz; {specimen.name} plays {specimen.sample_rate:g} Hz only, "
            "resample the drive.",
            field="drive.sample_rate",
        )
    expected = [channel.name for channel in specimen.drives]
    if names != expected:
        raise DriveError(
            f"the drive has {len(names)} channels ({', '.join(names) or 'none'}); {specimen.name} takes "
            f"{len(expected)} in this order: {', '.join(expected)}.",
            field="drive.channels",
        )
    wrong = [
        f"{channel.name} is in {unit!r} instead of {channel.unit!r}"
        for channel, unit in zip(specimen.drives, units, strict=True)
        if unit != channel.unit
    ]
    if wrong:
        raise DriveError(f"wrong units: {'; '.join(wrong)}.", field="drive.channels")
    if drive.ndim != 2 or len(drive) != len(expected):
        raise DriveError(
            f"the drive has the shape {drive.shape}; {specimen.name} takes ({len(expected)}, samples).",
            field="drive.samples",
        )
    samples = drive.shape[1]
    longest = specimen.longest_drive
    if samples < 1 or samples > longest * sample_rate:
        raise DriveError(
            f"the drive has {samples} samples; {specimen.name} plays 1 to {longest * sample_rate:.0f} ({longest:g} s).",
            field="drive.samples",
        )
    if not np.all(np.isfinite(drive)):
        channel, sample = np.argwhere(~np.isfinite(drive))[0]
        raise DriveError(
            f"the drive of {expected[channel]} is {drive[channel, sample]} at sample {sample}; every value must be "
            "finite.",
            field="drive.samples",
        )
    beyond = [
        text
        for channel, row in zip(specimen.drives, drive, strict=True)
        if (text := _beyond(channel, row, sample_rate, steps_in=specimen.approach.ramp == 0.0))
    ]
    if beyond:
        raise DriveError(
            f"the drive is beyond the limits of {specimen.name}: {'; '.join(beyond)}.", field="drive.samples"
        )


def _beyond(channel: InputChannel, row: np.ndarray, sample_rate: float, *, steps_in: bool) -> str:
    """Say what of one channel is beyond its limits, or return an empty text."""
    worst = int(np.argmax(np.maximum(row - channel.maximum, channel.minimum - row)))
    if not channel.minimum <= row[worst] <= channel.maximum:
        return (
            f"{channel.name} is {row[worst]:.4g} {channel.unit} at {worst / sample_rate:.3f} s, "
            f"allowed {channel.minimum:g} to {channel.maximum:g}"
        )
    if channel.slew_limit > 0.0:
        # A rig without a ramp to the first sample starts at rest with all drives zero: that is a step as well.
        rate = np.abs(np.diff(row, prepend=0.0 if steps_in else row[0])) * sample_rate
        fastest = int(np.argmax(rate))
        if rate[fastest] > channel.slew_limit:
            return (
                f"{channel.name} moves at {rate[fastest]:.3g} {channel.unit}/s at {fastest / sample_rate:.3f} s, "
                f"allowed {channel.slew_limit:g}"
            )
    return ""
