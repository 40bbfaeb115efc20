"""Campaign read from its recording: the committed steps, from the recorder."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from google.protobuf.message import Message

from duralab_bus import Bus, damaged_recording, message_of_step, recorded_steps
from duralab_proto.arrays import ArrayError, from_array, samples_hash
from duralab_proto.decisions import decisions_in_force
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2
from iterator.campaign.messages import with_samples

_KINDS: Final = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (
        iterator_pb2.CampaignSpec,
        rig_pb2.RigDescription,
        iterator_pb2.TargetInBand,
        recorder_pb2.RunPlanned,
        recorder_pb2.RunPlayed,
        identifier_pb2.Model,
        iterator_pb2.IterationStep,
        iterator_pb2.ConfirmationStep,
        iterator_pb2.Proposal,
        iterator_pb2.Decision,
        iterator_pb2.CampaignStatus,
        recorder_pb2.RecordingClosed,
    )
}


@dataclass
class RecordedCampaign:
    """Content of a recording, in the order of a campaign.

    `spec`: Specification. `steps`: Number of committed steps, which is the number of the next one. `last`: Last
    committed step, as committed. `iterations`, `confirmations`: The playbacks, with their samples. `targets`: Number
    of targets in the control band: one, and one for each change of the band.
    """

    spec: iterator_pb2.CampaignSpec
    steps: int = 1
    last: Message = field(default_factory=iterator_pb2.CampaignSpec)
    description: rig_pb2.RigDescription | None = None
    planned: list[str] = field(default_factory=list)
    played: set[str] = field(default_factory=set)
    model: identifier_pb2.Model | None = None
    iterations: list[iterator_pb2.IterationStep] = field(default_factory=list)
    confirmations: list[iterator_pb2.ConfirmationStep] = field(default_factory=list)
    proposals: list[iterator_pb2.Proposal] = field(default_factory=list)
    decisions: list[iterator_pb2.Decision] = field(default_factory=list)
    targets: int = 0
    final: iterator_pb2.CampaignStatus | None = None
    closed: bool = False

    def take(self, message: Message, *, samples: tuple[array_pb2.Array, array_pb2.Array] | None = None) -> None:
        """Add the next step; samples that it leaves to its run are given separately."""
        self.steps += 1
        self.last = message
        if isinstance(message, iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep) and samples is not None:
            message = self._with_samples(message, *samples)
        match message:
            case rig_pb2.RigDescription():
                self.description = message
            case recorder_pb2.RunPlanned():
                self.planned.append(message.run)
            case recorder_pb2.RunPlayed():
                self.played.add(message.run)
            case identifier_pb2.Model():
                self.model = message
            case iterator_pb2.IterationStep():
                self.iterations.append(message)
            case iterator_pb2.ConfirmationStep():
                self.confirmations.append(message)
            case iterator_pb2.Proposal():
                self.proposals = [each for each in self.proposals if not 0 < message.replaces <= each.number]
                self.proposals.append(message)
            case iterator_pb2.Decision():
                self.decisions.append(message)
            case iterator_pb2.TargetInBand():
                self.targets += 1
            case iterator_pb2.CampaignStatus():
                self.final = message
            case recorder_pb2.RecordingClosed():
                self.closed = True

    def _with_samples(
        self,
        step: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep,
        drive: array_pb2.Array,
        response: array_pb2.Array,
    ) -> Message:
        description = self.description or rig_pb2.RigDescription()
        played = from_array(drive, field="drive", shape=(len(description.drives), None), dtype=np.float64)
        shape = (len(description.responses), played.shape[1])
        measured = from_array(response, field="response", shape=shape, dtype=np.float64)
        if samples_hash(played, measured) != step.samples_hash:
            raise ArrayError(f"the samples of run {step.run!r} are not those of its hash", field="samples_hash")
        return with_samples(step, description=description, drive=played, response=measured)


def read_campaign(bus: Bus, id: str) -> RecordedCampaign:
    """Read all committed steps of a campaign's recording.

    `bus`: Bus of the recorder. `id`: Id of the campaign and its recording.
    Returns: The campaign up to its last step.
    Raises `FaultError`: NOT_FOUND if there is no such recording, DATA_LOSS if it is damaged or not a campaign's.
    """
    steps = recorded_steps(bus, id, with_samples=True)
    first = next(steps, None)
    spec = None if first is None else _message(id, first)
    if not isinstance(spec, iterator_pb2.CampaignSpec) or spec.id != id:
        raise damaged_recording(id, "its first step is not the specification of that campaign")
    recorded = RecordedCampaign(spec=spec, last=spec)
    for step in steps:
        try:
            recorded.take(
                _message(id, step), samples=(step.drive, step.response) if step.HasField("response") else None
            )
        except ArrayError as error:
            raise damaged_recording(id, str(error).rstrip(".")) from error
    recorded.decisions = decisions_in_force(recorded.decisions, recorded.proposals)
    for numbers in ([step.iteration for step in recorded.iterations], [step.number for step in recorded.confirmations]):
        if numbers != list(range(1, len(numbers) + 1)):
            raise damaged_recording(id, f"its playbacks are numbered {numbers}")
    return recorded


def _message(id: str, step: recorder_pb2.RecordedStep) -> Message:
    return message_of_step(id, step, _KINDS, of="a campaign")
