"""Steps of a recording, read back from the recorder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from google.protobuf.message import DecodeError, Message

from duralab_bus.bus import Bus
from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2, recorder_pb2


def recorded_steps(bus: Bus, recording: str, *, with_samples: bool = False) -> Iterator[recorder_pb2.RecordedStep]:
    """Yield the steps of a recording in their order; only as many are asked for as are taken.

    Parameters
    ----------
    bus : Bus
        Bus of the recorder.
    recording : str
        Id of the recording.
    with_samples : bool
        Whether a step that leaves its samples to its run comes with drive and response of that run.

    Returns
    -------
    iterator of duralab.v1.RecordedStep
        Steps 0, 1, 2 and so on.

    Raises
    ------
    FaultError
        NOT_FOUND if there is no such recording, DATA_LOSS if it is damaged.
    """
    first, total = 0, 1
    while first < total:
        request = recorder_pb2.ReadStepsRequest(first=first, with_samples=with_samples)
        answer = bus.query(bus.keys.recording_steps(recording), request, recorder_pb2.RecordedSteps)
        total = answer.total
        if first < total and not answer.steps:
            raise damaged_recording(recording, f"the recorder answered {first} of {total} steps and then nothing")
        for step in answer.steps:
            if step.step != first:
                why = f"the recorder answered step {step.step} in place of step {first}"
                raise damaged_recording(recording, why)
            first += 1
            yield step


def message_of_step(
    recording: str, step: recorder_pb2.RecordedStep, kinds: Mapping[str, type[Message]], *, of: str
) -> Message:
    """Return the message of a step.

    Parameters
    ----------
    recording : str
        Id of the recording.
    step : duralab.v1.RecordedStep
        Step of it.
    kinds : mapping of str to type
        Every message that such a recording may hold, by its full name.
    of : str
        Kind of the work that is recorded, with its article, e.g. "a campaign".

    Returns
    -------
    Message
        Message that was committed.

    Raises
    ------
    FaultError
        DATA_LOSS if it is of another type or cannot be decoded.
    """
    kind = kinds.get(step.message_type)
    if kind is None:
        why = f"its step {step.step} is of the type {step.message_type!r}, which is not one of {of}"
        raise damaged_recording(recording, why)
    try:
        return kind.FromString(step.payload)
    except DecodeError as error:
        raise damaged_recording(recording, f"its step {step.step} is not a {step.message_type}: {error}") from error


def damaged_recording(recording: str, why: str) -> FaultError:
    """Return the fault for a recording that cannot be read back.

    Parameters
    ----------
    recording : str
        Id of the recording.
    why : str
        Clause about what is wrong, without a full stop.

    Returns
    -------
    FaultError
        DATA_LOSS, which is not raised here.
    """
    return FaultError(
        query_pb2.FAULT_CODE_DATA_LOSS, f"The recording {recording!r} cannot be read back: {why}.", field="id"
    )
