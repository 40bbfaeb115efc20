"""Playback of one drive on a rig: read and check the drive, play it, stop and latch the rig."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from duralab.arguments import real_numbers, require_seed, require_switch, require_text
from duralab.data import LARGEST_RATE_ERROR, Played, Rig, RigState, Signals, actuator_use
from duralab.errors import InputError, LabError, LabTimeoutError, StoppedError, ended
from duralab.formats import LEFT_OUT, convert_units, named_units, read_signals
from duralab.lab.client import Deadline, LabClient
from duralab.lab.progress import RunProgress, Stage
from duralab_proto.arrays import ArrayError
from duralab_proto.v1 import query_pb2, rig_pb2

if TYPE_CHECKING:
    import xarray


def play_drive(
    ask: LabClient,
    rig: Rig,
    drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals,
    *,
    run: str | None,
    seed: int,
    real_time: bool,
    on_progress: Callable[[RunProgress], None],
    deadline: Deadline,
) -> Played:
    """Play a drive of shape (drives, samples) on a rig; see `Lab.play`."""
    require_seed(seed)
    if run is not None:
        require_text(run, field="run")
    require_switch(real_time, field="real_time")
    signals = drive_signals(drive, rig)
    name = run or f"script-{uuid.uuid4().hex[:12]}"
    request = rig_pb2.PlayRequest(run=name, drive=signals.to_message(), seed=seed, real_time=bool(real_time))

    def report(progress: query_pb2.Progress) -> None:
        on_progress(RunProgress(Stage.PLAYBACK, progress.phase, progress.fraction, progress.remaining_seconds))

    key = ask.key("rig", ask.bus.keys.rig_play, rig.name)
    what = f"The playback {name!r} on rig {rig.name!r}"
    with halting(ask, rig.name, deadline):
        result = ask.query(key, request, rig_pb2.PlayResult, on_progress=report, deadline=deadline, what=what)
    return Played(
        run=result.run,
        response=_checked_response(result, rig, run=name, samples=signals.samples.shape[1]),
        actuators=actuator_use(result.actuators),
        real_time_factor=result.real_time_factor,
        warnings=tuple(result.warnings),
    )


def _checked_response(result: rig_pb2.PlayResult, rig: Rig, *, run: str, samples: int) -> Signals:
    """Return the response of a rig; raises LabError if it does not match the request."""
    try:
        response = Signals.from_message(result.response, field="response")
    except ArrayError as error:
        raise _wrong_answer(rig, f"a damaged response: {str(error).rstrip('.')}", field=error.field) from error
    if result.run != run:
        raise _wrong_answer(rig, f"run {result.run!r}, asked was {run!r}", field="run")
    wanted = tuple(channel.name for channel in rig.responses)
    if response.names != wanted or response.sample_rate != rig.sample_rate:
        raise _wrong_answer(
            rig,
            f"{', '.join(response.names) or 'no channel'} at {response.sample_rate:g} Hz, not its responses "
            f"{', '.join(wanted)} at {rig.sample_rate:g} Hz",
            field="response",
        )
    if response.samples.shape[1] != samples:
        raise _wrong_answer(
            rig, f"{response.samples.shape[1]} samples to a drive of {samples}", field="response.samples"
        )
    return response


def _wrong_answer(rig: Rig, what: str, *, field: str) -> LabError:
    return LabError(
        f"The rig {rig.name!r} answered {what}; see what `duralab check-rig {rig.name}` finds.", field=field
    )


@contextmanager
def halting(ask: LabClient, rig: str, deadline: Deadline) -> Iterator[None]:
    """Stop a rig if the deadline ends its motion, so that it is at rest when the error is raised."""
    try:
        yield
    except (StoppedError, LabTimeoutError) as error:
        if not deadline.is_set():
            raise
        raise type(error)(f"{ended(str(error))} {_halted(ask, rig, str(error))}", service=error.service) from error


def _halted(ask: LabClient, rig: str, reason: str) -> str:
    """Stop a rig and return a sentence about the result."""
    try:
        # The cancelled query already makes the rig ramp down; the answer to the stop arrives when it is at rest.
        state = stop_rig(ask, rig, reason=reason)
    except LabError as error:
        return f"It is not known whether the rig rests ({error.message.rstrip('.')}): look at it."
    if state.goes_on:
        return f"{state.warning} The rig is latched from then on: wait for its end, look at it, then reset it."
    return "The rig was stopped and is latched: look at it, then reset it."


def stop_rig(ask: LabClient, rig: str, *, reason: str) -> RigState:
    """Ramp a rig down and latch it; return when it is at rest, or at once if its run cannot be stopped."""
    require_text(reason, field="reason")
    key = ask.key("rig", ask.bus.keys.rig_stop, rig)
    message = ask.query(key, rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)
    # By the contract, only a rig whose run cannot be stopped answers before it is at rest.
    return RigState.from_message(message, goes_on=bool(message.run))


def read_drive_file(path: Path, rig: Rig, *, units: Sequence[str] = ()) -> Signals:
    """Read a drive from a file of any format of `duralab.formats`, in the rig's order and units.

    Channels have the names of the rig's drives, in any order. `units`: One unit for all channels without a unit in the
    file, or "<channel>=<unit>", which replaces the file's unit of that channel. The attribute `LEFT_OUT` names channels
    of the file that are not numbers.
    """
    signals = read_signals(path)
    wanted = {channel.name: channel for channel in rig.drives}
    missing = [name for name in wanted if name not in signals.names]
    others = [name for name in signals.names if name not in wanted]
    if missing or others:
        faults = [f"lacks {', '.join(missing)}"] if missing else []
        faults += [f"has {', '.join(others)} besides"] if others else []
        raise InputError(
            f"{path} {' and '.join(faults)}; the drives of rig {rig.name!r} are {', '.join(wanted)}.",
            field="drive.channels",
        )
    if abs(signals.sample_rate / rig.sample_rate - 1) > LARGEST_RATE_ERROR:
        raise InputError(
            f"{path} is sampled at {signals.sample_rate:g} Hz; rig {rig.name!r} plays {rig.sample_rate:g} Hz only, so "
            f"make a copy with `duralab convert {path} COPY --rate {rig.sample_rate:g}`.",
            field="drive.sample_rate",
        )
    rows = [signals.names.index(name) for name in wanted]
    given = replace(signals, channels=tuple(signals.channels[row] for row in rows), samples=signals.samples[rows])
    labelled = _with_units(given, units, path=path, rig=rig)
    converted = convert_units(labelled, {channel.name: channel.unit for channel in rig.drives})
    told = {key: text for key, text in signals.attributes.items() if key == LEFT_OUT}
    return Signals(rig.drives, rig.sample_rate, converted.samples, attributes=told)


def _with_units(given: Signals, units: Sequence[str], *, path: Path, rig: Rig) -> Signals:
    """Return the channels with the given units; refuse a missing unit, because a guess would move the rig wrongly."""
    named, plain = named_units(units)
    strangers = [name for name in named if name not in given.names]
    if strangers:
        raise InputError(
            f"--unit names {', '.join(strangers)}; the drives of rig {rig.name!r} are {', '.join(given.names)}.",
            field="unit",
        )
    if len(plain) > 1:
        raise InputError(f"--unit gives {' and '.join(plain)} for all; give one, or CHANNEL=UNIT.", field="unit")
    silent = [channel.name for channel in given.channels if not (channel.unit.strip() or channel.name in named)]
    if plain and not silent:
        raise InputError(
            f"--unit is {plain[0]}, but {path} shows the unit of every drive; leave it out, or give CHANNEL=UNIT where "
            "the file is wrong.",
            field="unit",
        )
    if silent and not plain:
        allowed = ", ".join(dict.fromkeys(channel.unit for channel in rig.drives if channel.name in silent))
        raise InputError(
            f"{path} names no unit for {', '.join(silent)}, so that rig {rig.name!r} cannot play it; a unit that "
            f"converts to {allowed} is allowed, so say what the values are in: --unit UNIT, or --unit CHANNEL=UNIT.",
            field="drive.unit",
        )
    named |= dict.fromkeys(silent, *plain)
    channels = (replace(channel, unit=named.get(channel.name, channel.unit)) for channel in given.channels)
    return replace(given, channels=tuple(channels))


def drive_signals(drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals, rig: Rig) -> Signals:
    """Return the drive with the rig's channels, in the rig's order."""
    if isinstance(drive, Signals):
        return _checked(_in_order(drive, rig))
    # Detect datasets and arrays with channel names by their attributes: xarray is an optional import.
    if hasattr(drive, "data_vars") or "channel" in getattr(drive, "coords", ()):
        return _checked(_in_order(Signals.from_xarray(drive), rig))  # type: ignore[arg-type]
    samples = _real(drive)
    if samples.ndim != 2 or samples.shape[0] != len(rig.drives):
        names = ", ".join(channel.name for channel in rig.drives)
        raise InputError(
            f"The drive has the shape {samples.shape}; rig {rig.name!r} needs ({len(rig.drives)}, samples): {names}.",
            field="drive.samples",
        )
    return _checked(Signals(rig.drives, rig.sample_rate, samples))


def _real(samples: np.ndarray | xarray.DataArray | xarray.Dataset) -> np.ndarray:
    return real_numbers(samples, what="The drive", field="drive.samples")


def _in_order(signals: Signals, rig: Rig) -> Signals:
    wanted = [channel.name for channel in rig.drives]
    if sorted(signals.names) != sorted(wanted) or len(signals.samples) != len(wanted):
        return signals
    rows = [signals.names.index(name) for name in wanted]
    given = [signals.channels[row].unit.strip() for row in rows]
    silent = [drive for unit, drive in zip(given, rig.drives, strict=True) if drive.unit and not unit]
    if silent:
        raise InputError(
            f"The drive names no unit for {', '.join(drive.name for drive in silent)}; rig {rig.name!r} takes "
            f"{', '.join(dict.fromkeys(drive.unit for drive in silent))}, so name what the values are in, or give a "
            "plain array in the rig's units.",
            field="drive.unit",
        )
    channels = [signals.channels[row] for row in rows]
    # Use the rig's description of a channel, except for a channel in another unit, which the rig refuses.
    channels = (drive if one.unit == drive.unit else one for one, drive in zip(channels, rig.drives, strict=True))
    return replace(signals, channels=tuple(channels), samples=_real(signals.samples)[rows])


def _checked(signals: Signals) -> Signals:
    try:
        signals.to_message()
    except ArrayError as error:
        raise InputError(str(error), field=error.field) from error
    return signals
