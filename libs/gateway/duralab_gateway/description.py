"""The description of a rig: what follows from the rest of it, and what cannot be served."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable

import numpy as np

from duralab_bus import ConfigError
from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.keys import KeyNameError, check_rig
from duralab_proto.v1 import array_pb2, rig_pb2

_BLOCKS_A_SECOND = 10


def complete_description(told: rig_pb2.RigDescription) -> rig_pb2.RigDescription:
    """Return a description with block size, static response and content hash, where they were not given.

    Parameters
    ----------
    told : rig_pb2.RigDescription
        What a rig says of itself; not changed.

    Returns
    -------
    rig_pb2.RigDescription
        Ten blocks a second, responses of zero at rest, and the SHA-256 of the description itself.

    Raises
    ------
    ConfigError
        A name, a rate, a limit or the static response cannot be; one sentence.
    """
    description = rig_pb2.RigDescription()
    description.CopyFrom(told)
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
        raise ConfigError(f"{rig}: the names of {what} are {', '.join(names)}; each must have a name of its own.")
    for channel in channels:
        if not channel.minimum < channel.maximum:
            raise ConfigError(
                f"{rig}: {channel.name} has the range {channel.minimum:g} to {channel.maximum:g}; minimum must be "
                "below maximum."
            )
        if not channel.slew_limit >= 0.0:
            raise ConfigError(f"{rig}: slew_limit of {channel.name} is {channel.slew_limit:g}; it must be 0 or more.")
        if what == "drives" and not channel.minimum <= 0.0 <= channel.maximum:
            raise ConfigError(
                f"{rig}: the drive {channel.name} may go from {channel.minimum:g} to {channel.maximum:g}; a rig rests "
                "at zero, which must be allowed."
            )
