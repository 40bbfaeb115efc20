"""Rig on the bus: its description, and the playback of an experiment on it."""

import threading

import numpy as np
from numpy.typing import NDArray

from duralab_bus import Bus, Call, FaultError
from duralab_proto.arrays import ArrayError, from_record, to_record
from duralab_proto.v1 import identifier_pb2, query_pb2, rig_pb2
from identifier.experiment import RigUnderTest


def describe_rig(bus: Bus, rig: str) -> RigUnderTest:
    """Query the description of a rig.

    `bus`: Open bus. `rig`: Name of the rig.
    Returns: Description by the rig.
    Raises `FaultError`: The rig is missing, or its description cannot be used.
    """
    description = bus.query(bus.keys.rig_description(rig), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    try:
        return RigUnderTest.from_message(description)
    except ValueError as error:
        raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error


def play_experiment(
    bus: Bus,
    request: identifier_pb2.IdentifyRequest,
    *,
    rig: RigUnderTest,
    drive: NDArray[np.float64],
    call: Call,
    progress: tuple[float, float],
) -> tuple[rig_pb2.PlayResult, NDArray[np.float64]]:
    """Play the drive of an experiment and wait for the response; stop it when the client stops waiting.

    `bus`: Open bus. `request`: Names the run and the rig's seed. `rig`: The rig. `drive`: Shape (drives, samples), each
    row in its channel's unit. `call`: Receives the rig's progress. `progress`: Share of the whole query before and
    after the playback, 0 to 1.
    Returns: The rig's answer. Shape (responses, samples), each row in its channel's unit.
    Raises `FaultError`: The rig does not play, its answer does not match, or the client stopped waiting.
    """
    given_up = threading.Event()
    if call.cancelled:
        raise FaultError(
            query_pb2.FAULT_CODE_CANCELLED, f"Run {request.run!r} was cancelled before it was played; nothing moved."
        )
    begin, end = progress

    def pass_on(message: query_pb2.Progress) -> None:
        # The rig sends progress continuously, so a client that stopped waiting is noticed within a second.
        if call.cancelled:
            given_up.set()
        share = message.fraction if 0.0 <= message.fraction <= 1.0 else 0.0
        remaining = message.remaining_seconds if np.isfinite(message.remaining_seconds) else -1.0
        call.progress(message.phase, begin + (end - begin) * share, remaining_seconds=remaining, detail=message.detail)

    play = rig_pb2.PlayRequest(
        run=request.run,
        drive=to_record(rig.drives, rig.sample_rate, drive),
        seed=request.rig_seed,
        real_time=request.real_time,
    )
    played = bus.query(bus.keys.rig_play(request.rig), play, rig_pb2.PlayResult, on_progress=pass_on, cancel=given_up)
    if played.run != request.run:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Rig {rig.name!r} answered run {played.run!r}; asked was {request.run!r}.",
        )
    return played, _response_of(played, rig, drive.shape[1])


def _response_of(played: rig_pb2.PlayResult, rig: RigUnderTest, samples: int) -> NDArray[np.float64]:
    """Check that the answer of a playback matches the request, and return its response."""
    try:
        channels, sample_rate, response = from_record(played.response, field="response")
    except ArrayError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS, f"Rig {rig.name!r} answered a damaged response: {error}"
        ) from error
    names, expected = [c.name for c in channels], [c.name for c in rig.responses]
    if names != expected or sample_rate != rig.sample_rate or response.shape[1] != samples:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Rig {rig.name!r} answered {response.shape[1]} samples of {names} at {sample_rate:g} Hz; "
            f"{samples} of {expected} at {rig.sample_rate:g} Hz were expected.",
        )
    return response
