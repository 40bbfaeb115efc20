"""Messages that may be committed as steps of a recording: decoded and checked before they are logged."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeGuard

import numpy as np
from google.protobuf.message import DecodeError, Message

from duralab_proto.arrays import ArrayError, from_array, from_record
from duralab_proto.keys import check_id, check_rig, check_run
from duralab_proto.v1 import identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from recorder.format.summary import MOST_BLOCKS
from recorder.refused import invalid

LONGEST_TYPE_NAME: Final = 200


@dataclass(frozen=True)
class Step:
    """A committed step with checked content; the log keeps its payload unchanged (SHA-256, hexadecimal)."""

    number: int
    message: Message
    payload: bytes
    payload_hash: str

    @property
    def type_name(self) -> str:
        """Full name of the message, e.g. "duralab.v1.Model"."""
        return self.message.DESCRIPTOR.full_name


def type_name_of(kind: type[Message]) -> str:
    """Return the full name of a message, e.g. "duralab.v1.Model"."""
    return kind.DESCRIPTOR.full_name


def _check_names(message: recorder_pb2.RunPlanned | recorder_pb2.RunPlayed) -> None:
    for check, name, field in ((check_run, message.run, "run"), (check_rig, message.rig, "rig")):
        try:
            check(name)
        except ValueError as error:
            raise ArrayError(str(error), field=field) from error


def _check_rig_name(rig: str) -> None:
    try:
        check_rig(rig)
    except ValueError as error:
        raise ArrayError(str(error), field="rig") from error


def _check_played(message: recorder_pb2.RunPlayed) -> None:
    _check_names(message)
    if message.blocks == 0:
        raise ArrayError("blocks is 0; a run that was played has 1 block or more.", field="blocks")
    if message.blocks > MOST_BLOCKS:
        raise ArrayError(f"blocks is {message.blocks}; at most {MOST_BLOCKS} are allowed.", field="blocks")


def _check_description(message: rig_pb2.RigDescription) -> None:
    for field, channels in (("drives", message.drives), ("responses", message.responses)):
        names = [channel.name for channel in channels]
        if not names or "" in names or len(set(names)) != len(names):
            raise ArrayError(f"{field} has the names {names}; each channel needs its own name.", field=field)
    from_array(message.static_response, field="static_response", shape=(len(message.responses),), dtype=np.float64)


def _check_model(message: identifier_pb2.Model) -> None:
    lines = from_array(message.frequency, field="frequency", shape=(None,), dtype=np.float64).size
    responses, drives = len(message.responses), len(message.drives)
    # Lines without excitation hold no estimate: their values may be NaN.
    from_array(message.frf, field="frf", shape=(lines, responses, drives), dtype=np.complex128, finite=False)
    from_array(message.coherence, field="coherence", shape=(lines, responses), dtype=np.float64, finite=False)


PlaybackStep = iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep | sequencer_pb2.EnduranceRepeat
"""Steps whose samples are those of a run."""

_HASH: Final = re.compile("[0-9a-f]{64}")


def leaves_samples_out(message: Message) -> TypeGuard[PlaybackStep]:
    """Return whether a step holds only the hash of its run's samples, which are in the run's signal blocks."""
    if isinstance(message, sequencer_pb2.EnduranceRepeat):
        return bool(message.samples_hash)
    return isinstance(message, PlaybackStep) and not message.HasField("response")


def _check_pre_test(message: iterator_pb2.PreTest) -> None:
    drives, responses = len(message.drives), len(message.responses)
    from_array(message.peak, field="peak", shape=(responses, drives), dtype=np.float64)
    from_array(message.response, field="response", shape=(responses, None), dtype=np.float32)


def _check_iteration(message: iterator_pb2.IterationStep) -> None:
    if message.iteration == 0:
        raise ArrayError("iteration is 0; playbacks are numbered from 1.", field="iteration")
    if message.HasField("drive") != message.HasField("response"):
        raise ArrayError("drive and response are not both given; give both or neither.", field="drive")
    if message.HasField("drive"):
        from_record(message.drive, field="drive")
    _check_samples(message)


def _check_confirmation(message: iterator_pb2.ConfirmationStep) -> None:
    if message.number == 0:
        raise ArrayError("number is 0; playbacks that confirm a result are numbered from 1.", field="number")
    _check_samples(message)


def _check_proposal(message: iterator_pb2.Proposal) -> None:
    if 0 in (message.number, message.playback):
        raise ArrayError("number or playback is 0; both are counted from 1.", field="number")
    if not message.refusal:
        _, _, drive = from_record(message.drive, field="drive")
        shape = (len(message.responses), drive.shape[1])
        from_array(message.predicted_response, field="predicted_response", shape=shape, dtype=np.float32)


def _check_decision(message: iterator_pb2.Decision) -> None:
    for field in ("proposal", "playback", "kind", "name", "reason"):
        if not getattr(message, field):
            raise ArrayError(f"{field} is left out; a decision says who decides what, on which proposal.", field=field)


def _check_endurance(message: sequencer_pb2.EnduranceSpec | sequencer_pb2.EnduranceVolume) -> None:
    _check_rig_name(message.rig)
    try:
        check_id(message.id)
    except ValueError as error:
        raise ArrayError(str(error), field="id") from error


def _check_repeat(message: sequencer_pb2.EnduranceRepeat) -> None:
    if message.HasField("statistics"):
        # The residual is NaN before a baseline exists.
        from_array(message.statistics, field="statistics", shape=(None, None), dtype=np.float64, finite=False)
    if message.HasField("damage"):
        from_array(message.damage, field="damage", shape=(None,), dtype=np.float64)
    _check_run_name(message.run)
    if message.samples_hash:
        _check_left_out(message)


def _check_repeat_samples(message: sequencer_pb2.RepeatSamples) -> None:
    _check_run_name(message.run)
    from_record(message.response, field="response")


def _check_correction(message: sequencer_pb2.EnduranceCorrection) -> None:
    if message.HasField("damage"):
        from_array(message.damage, field="damage", shape=(None,), dtype=np.float64)


def _check_run_name(run: str) -> None:
    try:
        check_run(run)
    except ValueError as error:
        raise ArrayError(str(error), field="run") from error


def _check_left_out(message: PlaybackStep) -> None:
    """Check the run, hash and block count of a step without samples."""
    _check_run_name(message.run)
    if not _HASH.fullmatch(message.samples_hash):
        raise ArrayError(
            f"samples_hash is {message.samples_hash[:80]!r}; a step without samples names their SHA-256, 64 "
            "hexadecimal digits.",
            field="samples_hash",
        )
    if not 0 < message.signal_blocks <= MOST_BLOCKS:
        raise ArrayError(
            f"signal_blocks is {message.signal_blocks}; a step without samples has 1 to {MOST_BLOCKS} of them.",
            field="signal_blocks",
        )


def _check_samples(message: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep) -> None:
    """Check the samples of a step, or its reference to the run that holds them."""
    shape: tuple[int | None, ...] = (None, None)
    if message.HasField("response"):
        _, _, response = from_record(message.response, field="response")
        shape = response.shape
    else:
        _check_left_out(message)
    if message.HasField("error_in_band"):
        from_array(message.error_in_band, field="error_in_band", shape=shape, dtype=np.float32)
    else:
        from_array(message.response_in_band, field="response_in_band", shape=shape, dtype=np.float64)


_CHECKS: Final[dict[type[Message], Callable[[Any], object]]] = {
    iterator_pb2.CampaignSpec: lambda message: from_record(message.target, field="target"),
    rig_pb2.RigDescription: _check_description,
    iterator_pb2.TargetInBand: lambda message: from_array(
        message.samples, field="samples", shape=(None, None), dtype=np.float64
    ),
    recorder_pb2.RunPlanned: _check_names,
    recorder_pb2.RunPlayed: _check_played,
    identifier_pb2.Model: _check_model,
    iterator_pb2.IterationStep: _check_iteration,
    iterator_pb2.ConfirmationStep: _check_confirmation,
    iterator_pb2.Proposal: _check_proposal,
    iterator_pb2.Decision: _check_decision,
    iterator_pb2.CampaignStatus: lambda _: None,
    iterator_pb2.PreTestRequest: lambda message: _check_rig_name(message.rig),
    iterator_pb2.PreTest: _check_pre_test,
    sequencer_pb2.EnduranceSpec: _check_endurance,
    sequencer_pb2.EnduranceVolume: _check_endurance,
    sequencer_pb2.EnduranceRepeat: _check_repeat,
    sequencer_pb2.RepeatSamples: _check_repeat_samples,
    sequencer_pb2.CorrectionPlanned: lambda _: None,
    sequencer_pb2.EnduranceCorrection: _check_correction,
    sequencer_pb2.EnduranceDrive: lambda message: from_record(message.drive, field="drive"),
    sequencer_pb2.EnduranceHold: lambda _: None,
    sequencer_pb2.EnduranceDecision: lambda _: None,
    sequencer_pb2.EnduranceStatus: lambda _: None,
    recorder_pb2.RecordingClosed: lambda _: None,
}

STEP_TYPES: Final[dict[str, type[Message]]] = {kind.DESCRIPTOR.full_name: kind for kind in _CHECKS}
"""Message class by full name, for every message that may be committed."""


def decode_step(request: recorder_pb2.CommitRequest) -> Step:
    """Decode and check the untrusted payload of a commit."""
    kind = STEP_TYPES.get(request.message_type)
    if kind is None:
        raise invalid(
            f"The message type {request.message_type[:LONGEST_TYPE_NAME]!r} is not a step; "
            f"allowed are {', '.join(sorted(STEP_TYPES))}.",
            field="message_type",
        )
    message = kind()
    try:
        message.ParseFromString(request.payload)
    except DecodeError as error:
        raise invalid(
            f"The payload of {len(request.payload)} bytes is not a {request.message_type}: {error}.", field="payload"
        ) from error
    try:
        _CHECKS[kind](message)
    except ArrayError as error:
        raise invalid(f"{kind.DESCRIPTOR.name}: {error}", field=f"payload.{error.field}") from error
    return Step(
        number=request.step,
        message=message,
        payload=request.payload,
        payload_hash=hashlib.sha256(request.payload).hexdigest(),
    )
