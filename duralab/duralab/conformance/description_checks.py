"""Checks of what a rig says of itself."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from duralab.conformance.bench import Bench, expect
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import array_pb2, rig_pb2

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_UNITS = {
    array_pb2.CHANNEL_KIND_DISPLACEMENT: "m",
    array_pb2.CHANNEL_KIND_FORCE: "N",
    array_pb2.CHANNEL_KIND_MOMENT: "N*m",
    array_pb2.CHANNEL_KIND_ACCELERATION: "m/s^2",
    array_pb2.CHANNEL_KIND_PRESSURE: "Pa",
    array_pb2.CHANNEL_KIND_RATIO: "1",
    array_pb2.CHANNEL_KIND_VELOCITY: "m/s",
}


def check_is_live(bench: Bench) -> None:
    """Check that its liveliness token is on the bus."""
    expect(
        ("rig_sim", bench.rig) in bench.bus.discover("rig_sim", bench.rig),
        f"the liveliness token live/rig_sim/{bench.rig} is not on the bus; declare it last.",
    )


def check_figures(bench: Bench) -> None:
    """Check that name, rate, lengths, statics and hash are there and make sense."""
    told = bench.description
    expect(told.rig == bench.rig, f"the description is of {told.rig!r}; asked was {bench.rig!r}.")
    for field in ("specimen", "engine", "version"):
        expect(bool(getattr(told, field)), f"{field} is empty; say what it is.")
    for field, value in (("sample_rate", told.sample_rate), ("longest_drive_seconds", told.longest_drive_seconds)):
        expect(np.isfinite(value) and value > 0.0, f"{field} is {value:g}; it must be above 0.")
    expect(told.block_samples > 0, "block_samples is 0; say how many samples a full signal block has.")
    expect(
        re.fullmatch(r"[0-9a-f]{64}", told.content_hash) is not None,
        f"content_hash is {told.content_hash!r}; it must be a SHA-256 in hexadecimal.",
    )
    expect(len(set(told.bodies)) == len(told.bodies), "two bodies of the pose stream have one name.")
    try:
        from_array(told.static_response, field="static_response", shape=(len(told.responses),), dtype=np.float64)
    except ArrayError as error:
        expect(False, f"{str(error).rstrip('.')}; it must hold one finite value for each response.")


def check_channels(bench: Bench) -> None:
    """Check that names, units and limits of drives and responses make sense."""
    _check_channels("drive", bench.description.drives)
    _check_channels("response", bench.description.responses)
    for channel in bench.description.drives:
        expect(
            channel.minimum <= 0.0 <= channel.maximum,
            f"drive {channel.name!r} goes from {channel.minimum:g} to {channel.maximum:g}; 0 is where it begins.",
        )


def check_is_stable(bench: Bench) -> None:
    """Check that asked again, it says the same."""
    again = bench.describe()
    expect(
        again.SerializeToString(deterministic=True) == bench.description.SerializeToString(deterministic=True),
        "the description is another one when asked again; it may change only with the rig.",
    )


def check_is_idle(bench: Bench) -> None:
    """Check that it may be played: nothing plays, nothing is latched."""
    state = bench.state()
    expect(state.rig == bench.rig, f"the state is of {state.rig!r}; asked was {bench.rig!r}.")
    expect(
        state.mode == rig_pb2.RIG_MODE_IDLE,
        f"the rig is {rig_pb2.RigMode.Name(state.mode)} ({state.reason or state.run}); a check begins with an idle "
        "rig, see to it and reset it.",
    )
    expect(not state.reason and not state.run, "an idle rig has a reason or a run; both must be empty.")


def _check_channels(what: str, channels: Sequence[array_pb2.Channel]) -> None:
    expect(bool(channels), f"it has no {what}s; it needs at least one.")
    names = [channel.name for channel in channels]
    expect(len(set(names)) == len(names), f"two {what}s have one name; names must differ.")
    for channel in channels:
        expect(
            _NAME.fullmatch(channel.name) is not None,
            f"a {what} is called {channel.name!r}; names are lower_snake_case.",
        )
        unit = _UNITS.get(channel.kind)
        expect(unit is not None, f"{what} {channel.name!r} has no kind; say what it is.")
        expect(
            channel.unit == unit,
            f"{what} {channel.name!r} is in {channel.unit!r}; its kind is in {unit!r}, SI units throughout.",
        )
        limits = np.array([channel.minimum, channel.maximum, channel.slew_limit])
        expect(
            bool(np.all(np.isfinite(limits))) and channel.minimum < channel.maximum and channel.slew_limit >= 0.0,
            f"{what} {channel.name!r} goes from {channel.minimum:g} to {channel.maximum:g} at up to "
            f"{channel.slew_limit:g} a second; limits are finite and in order.",
        )
