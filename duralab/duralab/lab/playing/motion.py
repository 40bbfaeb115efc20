"""Moving one rig: a playback, its stop, the latch."""

from __future__ import annotations

import secrets
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from duralab.arguments import require_seed, require_switch, require_text
from duralab.data import Played, Rig, RigState, Signals, actuator_use
from duralab.errors import LabError, LabTimeoutError, StoppedError, ended
from duralab.lab.client import LabClient
from duralab.lab.deadline import Deadline
from duralab.lab.playing.drives import drive_signals
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
    tell: Callable[[RunProgress], None],
    deadline: Deadline,
) -> Played:
    """Play a drive on a rig; see `Lab.play`.

    `ask`, `rig`, `drive`, `run`, `seed`, `real_time`, `tell`, `deadline`: The lab, the rig as it described itself, and
    what `Lab.play` was given; drives have shape (drives, samples).
    Returns: What came back.
    Raises `LabError`: See `Lab.play`.
    """
    require_seed(seed)
    if run is not None:
        require_text(run, field="run")
    require_switch(real_time, field="real_time")
    signals = drive_signals(drive, rig)
    name = run or f"script-{uuid.uuid4().hex[:12]}"
    request = rig_pb2.PlayRequest(run=name, drive=signals.to_message(), seed=seed, real_time=bool(real_time))

    def report(progress: query_pb2.Progress) -> None:
        tell(RunProgress(Stage.PLAYBACK, progress.phase, progress.fraction, progress.remaining_seconds))

    key = ask.key("rig", ask.bus.keys.rig_play, rig.name)
    what = f"The playback {name!r} on rig {rig.name!r}"
    with halting(ask, rig.name, deadline):
        result = ask.query(key, request, rig_pb2.PlayResult, on_progress=report, deadline=deadline, what=what)
    return Played(
        run=result.run,
        response=_checked_response(result, rig, run=name, samples=signals.samples.shape[1]),
        actuators=actuator_use(result.actuators),
        real_time_factor=result.real_time_factor,
    )


def _checked_response(result: rig_pb2.PlayResult, rig: Rig, *, run: str, samples: int) -> Signals:
    """Return what a rig answered; raises LabError where it is not the answer to what was asked."""
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
    """Stop a rig where the deadline with what moves it ends, so that it rests when the error arrives.

    `ask`: The session. `rig`: Name of the rig. `deadline`: Deadline of what moves the rig.
    Yields: Nothing; the body of the `with` statement moves the rig.
    Raises `LabTimeoutError`: The time is over. `StoppedError`: The wait was cancelled.
    """
    try:
        yield
    except (StoppedError, LabTimeoutError) as error:
        if not deadline.is_set():
            raise
        raise type(error)(f"{ended(str(error))} {_halted(ask, rig, str(error))}", service=error.service) from error


def _halted(ask: LabClient, rig: str, reason: str) -> str:
    """Stop a rig; return a sentence about what came of it."""
    try:
        # The rig ramps down as soon as it learns that nobody waits; the answer to a stop tells when it rests.
        state = stop_rig(ask, rig, reason=reason)
    except LabError as error:
        return f"It is not known whether the rig rests ({error.message.rstrip('.')}): look at it."
    if state.goes_on:
        return f"{state.warning} The rig is latched from then on: wait for its end, look at it, then reset it."
    return "The rig was stopped and is latched: look at it, then reset it."


def stop_rig(ask: LabClient, rig: str, *, reason: str) -> RigState:
    """Ramp a rig down and latch it; return when it rests, or at once where its run cannot be stopped.

    `ask`: The session. `rig`: Name of the rig. `reason`: Why it is stopped, in words.
    Returns: State after the stop.
    """
    require_text(reason, field="reason")
    key = ask.key("rig", ask.bus.keys.rig_stop, rig)
    message = ask.query(key, rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)
    # The contract: only a rig that cannot be stopped answers before it rests.
    return RigState.from_message(message, goes_on=bool(message.run))


def reset_rig(ask: LabClient, rig: str) -> RigState:
    """Clear the latch of a rig.

    `ask`: The session. `rig`: Name of the rig.
    Returns: State after the reset.
    """
    key = ask.key("rig", ask.bus.keys.rig_reset, rig)
    return RigState.from_message(ask.query(key, rig_pb2.ResetRequest(command=secrets.token_hex(16)), rig_pb2.RigState))


def state_of_rig(ask: LabClient, rig: str) -> RigState:
    """Ask a rig what it does.

    `ask`: The session. `rig`: Name of the rig.
    Returns: State of the rig.
    """
    key = ask.key("rig", ask.bus.keys.rig_state, rig)
    return RigState.from_message(ask.query(key, rig_pb2.StateRequest(), rig_pb2.RigState))
