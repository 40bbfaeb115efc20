"""Description of a rig, and the check of a drive against it before anything moves."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence

import numpy as np

from duralab_bus import ConfigError, FaultError
from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.keys import KeyNameError, check_rig
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2

_BLOCKS_A_SECOND = 10


def complete_description(given: rig_pb2.RigDescription) -> rig_pb2.RigDescription:
    """Return a description with block size, static response and content hash, if these were not given.

    Parameters
    ----------
    given : rig_pb2.RigDescription
        Description of the rig; not changed.

    Returns
    -------
    rig_pb2.RigDescription
        Description with ten blocks a second, responses of zero at rest, and the SHA-256 of the description itself.

    Raises
    ------
    ConfigError
        A name, a rate, a limit or the static response is not possible; one sentence.
    """
    description = rig_pb2.RigDescription()
    description.CopyFrom(given)
    rig = description.rig
    try:
        check_rig(rig)
    except KeyNameError as error:
        raise ConfigError(f"rig: {error}") from error
    for name, value in (
        ("sample_rate", description.sample_rate),
        ("longest_drive_seconds", description.longest_drive_seconds),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigError(f"{rig}: {name} is {value:g}; it must be above 0.")
    for what, channels in (("drives", description.drives), ("responses", description.responses)):
        _check_channels(rig, what, channels)
    if not description.block_samples:
        description.block_samples = max(round(description.sample_rate / _BLOCKS_A_SECOND), 1)
    if not description.HasField("static_response"):
        description.static_response.CopyFrom(to_array(np.zeros(len(description.responses))))
    try:
        shape = (len(description.responses),)
        from_array(description.static_response, field="static_response", shape=shape, dtype=np.float64)
    except ArrayError as error:
        raise ConfigError(f"{rig}: {error}") from error
    if not description.content_hash:
        content = description.SerializeToString(deterministic=True)
        description.content_hash = hashlib.sha256(content).hexdigest()
    return description


def _check_channels(rig: str, what: str, channels: Iterable[array_pb2.Channel]) -> None:
    names = [channel.name for channel in channels]
    if not names:
        raise ConfigError(f"{rig}: {what} is empty; describe one channel or more.")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice or "" in names:
        raise ConfigError(f"{rig}: the names of {what} are {', '.join(names)}; each must have its own name.")
    for channel in channels:
        if not channel.minimum < channel.maximum:
            raise ConfigError(
                f"{rig}: {channel.name} has the range {channel.minimum:g} to {channel.maximum:g}; minimum must be "
                "below maximum."
            )
        if not channel.slew_limit >= 0.0:
            raise ConfigError(f"{rig}: slew_limit of {channel.name} is {channel.slew_limit:g}; it must be 0 or more.")
        if not 0.0 <= channel.actuator_speed < math.inf:
            raise ConfigError(
                f"{rig}: actuator_speed of {channel.name} is {channel.actuator_speed:g}; it must be finite, 0 or more."
            )
        if what == "drives" and not channel.minimum <= 0.0 <= channel.maximum:
            raise ConfigError(
                f"{rig}: the drive {channel.name} may go from {channel.minimum:g} to {channel.maximum:g}; a rig rests "
                "at zero, which must be allowed."
            )


def check_drive(
    description: rig_pb2.RigDescription,
    channels: Sequence[array_pb2.Channel],
    sample_rate: float,
    drive: np.ndarray,
    *,
    steps_in: bool = False,
) -> None:
    """Check a drive (channels, samples), each row in its channel's unit, against a rig's channels and limits.

    `steps_in` states whether the rig goes from zero to the first sample at once. Raises `FaultError` INVALID_ARGUMENT
    with the field, if rate, channels, units, length, a value, a limit or a slew rate is not allowed. Every bad channel
    of the first kind of error is named at once.
    """
    rig = description.rig
    if sample_rate != description.sample_rate:
        raise _refusal(
            f"the drive's sample rate is {sample_rate:g} Hz; {rig} plays {description.sample_rate:g} Hz only, "
            "resample the drive.",
            field="drive.sample_rate",
        )
    names = [channel.name for channel in channels]
    expected = [channel.name for channel in description.drives]
    if names != expected:
        raise _refusal(
            f"the drive has {len(names)} channels ({', '.join(names) or 'none'}); {rig} takes "
            f"{len(expected)} in this order: {', '.join(expected)}.",
            field="drive.channels",
        )
    wrong = [
        f"{own.name} is in {channel.unit!r} instead of {own.unit!r}"
        for own, channel in zip(description.drives, channels, strict=True)
        if channel.unit != own.unit
    ]
    if wrong:
        raise _refusal(f"wrong units: {'; '.join(wrong)}.", field="drive.channels")
    if drive.ndim != 2 or len(drive) != len(expected):
        raise _refusal(
            f"the drive has the shape {drive.shape}; {rig} takes ({len(expected)}, samples).", field="drive.samples"
        )
    samples = drive.shape[1]
    longest = description.longest_drive_seconds
    if samples < 1 or samples > longest * sample_rate:
        raise _refusal(
            f"the drive has {samples} samples; {rig} plays 1 to {longest * sample_rate:.0f} ({longest:g} s).",
            field="drive.samples",
        )
    if not np.all(np.isfinite(drive)):
        channel, sample = np.argwhere(~np.isfinite(drive))[0]
        raise _refusal(
            f"the drive of {expected[channel]} is {drive[channel, sample]} at sample {sample}; every value must be "
            "finite.",
            field="drive.samples",
        )
    beyond = [
        text
        for own, row in zip(description.drives, drive, strict=True)
        if (text := _beyond(own, row, sample_rate, steps_in=steps_in))
    ]
    if beyond:
        raise _refusal(f"the drive is beyond the limits of {rig}: {'; '.join(beyond)}.", field="drive.samples")


def _refusal(sentence: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, sentence, field=field)


def _beyond(channel: array_pb2.Channel, row: np.ndarray, sample_rate: float, *, steps_in: bool) -> str:
    """Return as text where one channel exceeds its limits, or an empty string."""
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
