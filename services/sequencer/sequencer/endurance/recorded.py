"""Endurance test read from its recordings: the state for the next repeat, from the last recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from google.protobuf.message import Message

from duralab_bus import Bus, FaultError, damaged_recording, message_of_step, recorded_steps
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from sequencer.endurance.test_log import last_volume, volume_name

_KINDS: Final = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (
        sequencer_pb2.EnduranceSpec,
        sequencer_pb2.EnduranceVolume,
        rig_pb2.RigDescription,
        recorder_pb2.RunPlanned,
        recorder_pb2.RunPlayed,
        sequencer_pb2.EnduranceRepeat,
        sequencer_pb2.RepeatSamples,
        sequencer_pb2.CorrectionPlanned,
        sequencer_pb2.EnduranceCorrection,
        sequencer_pb2.EnduranceDrive,
        sequencer_pb2.EnduranceHold,
        sequencer_pb2.EnduranceDecision,
        sequencer_pb2.EnduranceStatus,
        recorder_pb2.RecordingClosed,
    )
}


@dataclass
class RecordedVolume:
    """Content of one recording of an endurance test.

    `steps`: Number of committed steps. `volume`: Its beginning; None if a crash came before. `repeats`: In order,
    without those of earlier recordings. `changes`: Repeats, decisions and drives in their order. `announced`: An
    announced run without any later step. `hold`: A hold without a decision. `iterating`: A hold with the decision to
    iterate again that is not done. `corrections`: Counted corrections of drives. `correcting`: A planned correction
    that is not counted. `samples`: Repeats with their samples in a step. `played`: Runs with a stored
    RunPlayed.
    """

    number: int
    steps: int = 0
    last: Message | None = None
    spec: sequencer_pb2.EnduranceSpec | None = None
    volume: sequencer_pb2.EnduranceVolume | None = None
    description: rig_pb2.RigDescription | None = None
    repeats: list[sequencer_pb2.EnduranceRepeat] = field(default_factory=list)
    changes: list[Message] = field(default_factory=list)
    drives: list[sequencer_pb2.EnduranceDrive] = field(default_factory=list)
    announced: recorder_pb2.RunPlanned | None = None
    hold: sequencer_pb2.EnduranceHold | None = None
    iterating: sequencer_pb2.EnduranceHold | None = None
    corrections: list[sequencer_pb2.EnduranceCorrection] = field(default_factory=list)
    correcting: sequencer_pb2.CorrectionPlanned | None = None
    holds: int = 0
    samples: set[int] = field(default_factory=set)
    played: set[str] = field(default_factory=set)
    final: sequencer_pb2.EnduranceStatus | None = None
    closed: bool = False

    def take(self, message: Message) -> None:
        """Add the next step."""
        self.steps += 1
        self.last = message
        match message:
            case sequencer_pb2.EnduranceSpec():
                self.spec = message
            case sequencer_pb2.EnduranceVolume():
                self.volume = message
                self.holds = message.holds
            case rig_pb2.RigDescription():
                self.description = message
            case recorder_pb2.RunPlanned():
                self.announced = message
            case recorder_pb2.RunPlayed():
                self.played.add(message.run)
            case sequencer_pb2.EnduranceRepeat():
                self.repeats.append(message)
                self.iterating = None
                self.changes.append(message)
                self.announced = None
            case sequencer_pb2.RepeatSamples():
                self.samples.add(message.repeat)
            case sequencer_pb2.CorrectionPlanned() | sequencer_pb2.EnduranceCorrection():
                self._take_correction(message)
            case sequencer_pb2.EnduranceDrive():
                self.drives.append(message)
                self.iterating = None
                self.changes.append(message)
            case sequencer_pb2.EnduranceHold() | sequencer_pb2.EnduranceDecision():
                self._take_hold(message)
            case sequencer_pb2.EnduranceStatus():
                self.final = message
            case recorder_pb2.RecordingClosed():
                self.closed = True

    def _take_correction(self, message: sequencer_pb2.CorrectionPlanned | sequencer_pb2.EnduranceCorrection) -> None:
        if isinstance(message, sequencer_pb2.CorrectionPlanned):
            self.correcting = message
            return
        self.corrections.append(message)
        self.correcting = None

    def _take_hold(self, message: sequencer_pb2.EnduranceHold | sequencer_pb2.EnduranceDecision) -> None:
        if isinstance(message, sequencer_pb2.EnduranceHold):
            # The rig refused the announced run and did not move.
            self.announced = None
            self.hold, self.holds, self.iterating = message, message.number, None
            return
        if message.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN:
            self.iterating = self.hold
        self.hold = None
        self.changes.append(message)


@dataclass(frozen=True)
class RecordedTest:
    """An endurance test up to its last step: its specification, and the last recording that has a step."""

    spec: sequencer_pb2.EnduranceSpec
    last: RecordedVolume


def read_endurance(bus: Bus, id: str) -> RecordedTest:
    """Read an endurance test from its recordings.

    Raises FaultError: NOT_FOUND if there is no such recording, DATA_LOSS if it is damaged or not an endurance test's.
    """
    number = last_volume(bus, id)
    if number == 0:
        raise FaultError(
            query_pb2.FAULT_CODE_NOT_FOUND,
            f"There is no recording of an endurance test {id!r}; `duralab catalogue` lists all recordings.",
            field="id",
        )
    last = _read_volume(bus, id, number)
    spec = last.spec if number == 1 else _specification(bus, id)
    if spec is None or spec.id != id:
        raise damaged_recording(id, "its first step is not the specification of that endurance test")
    if last.volume is None and number > 1:
        raise damaged_recording(
            id, f"the recording {volume_name(id, number)} does not begin as one of an endurance test"
        )
    return RecordedTest(spec, last)


def _specification(bus: Bus, id: str) -> sequencer_pb2.EnduranceSpec | None:
    first = next(recorded_steps(bus, id), None)
    message = None if first is None else _message(id, first)
    return message if isinstance(message, sequencer_pb2.EnduranceSpec) else None


def _read_volume(bus: Bus, id: str, number: int) -> RecordedVolume:
    volume = RecordedVolume(number)
    recording = volume_name(id, number)
    for step in recorded_steps(bus, recording):
        volume.take(_message(recording, step))
    numbers = [repeat.repeat for repeat in volume.repeats]
    first = volume.volume.first_repeat if volume.volume is not None else 0
    if numbers != list(range(first, first + len(numbers))):
        raise damaged_recording(id, f"the repeats of {recording} are not numbered from {first} on")
    return volume


def _message(recording: str, step: recorder_pb2.RecordedStep) -> Message:
    return message_of_step(recording, step, _KINDS, of="an endurance test")
