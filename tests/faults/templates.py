"""Sound messages of every kind, taken from a real recording: what is spoiled is what a service would have acted on."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

import duralab
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2, sequencer_pb2

from .lab_under_fault import RIG

MODEL = "unknown-model"
_KEPT_SECONDS = 2.0


def template(kind: type[Message], recording: Path) -> Message:
    """Return a sound message of a kind, shortened where it is long."""
    made = _made(recording)
    return made[kind.DESCRIPTOR.full_name] if kind.DESCRIPTOR.full_name in made else kind()


@cache
def _made(path: Path) -> dict[str, Message]:
    recording = duralab.open_recording(path)
    spec = recording.specification
    step = next(recording.messages(iterator_pb2.IterationStep))
    drive = recording.playback(step.iteration).drive.to_message()
    model = next(recording.messages(identifier_pb2.Model))
    state = rig_pb2.RigState(rig=RIG, mode=rig_pb2.RIG_MODE_PLAYING, run="a", fraction=0.5)
    status = iterator_pb2.CampaignStatus(id="a", phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING, iterations=[step.metrics])
    made: list[Message] = [
        iterator_pb2.CampaignSpec(),
        iterator_pb2.ResumeCampaignRequest(new_id="b", from_iteration=1, update=spec.update, stop=spec.stop),
        iterator_pb2.StopCampaignRequest(reason="asked by a test"),
        iterator_pb2.Decision(proposal=1, kind=iterator_pb2.DECISION_KIND_PLAY, name="Ada", reason="asked by a test"),
        iterator_pb2.CampaignEvent(status=status),
        recorder_pb2.CommitRequest(
            recording="a",
            message_type=recorder_pb2.RunPlanned.DESCRIPTOR.full_name,
            payload=recorder_pb2.RunPlanned(run="a", rig=RIG, purpose="x").SerializeToString(),
        ),
        recorder_pb2.ReadRecordingRequest(offset=0, length=1000, part="recording"),
        recorder_pb2.ReadStepsRequest(first=0),
        rig_pb2.PlayRequest(run="a", drive=drive),
        rig_pb2.StopRequest(reason="asked by a test"),
        sequencer_pb2.EnduranceSpec(
            id="a",
            rig=RIG,
            schedule=f"{{name: a, rig: {RIG}, events: {{road: {{drive: a.csv, repeats: 2}}}}}}",
            events=[sequencer_pb2.ScheduledEvent(name="road", drive=drive)],
        ),
        sequencer_pb2.StopEnduranceRequest(reason="asked by a test"),
        sequencer_pb2.HoldEnduranceRequest(reason="asked by a test"),
        sequencer_pb2.EnduranceDecision(
            hold=1, kind=sequencer_pb2.ENDURANCE_DECISION_KIND_END, name="Ada", reason="asked by a test"
        ),
        rig_pb2.RigFrfRequest(frequency=model.frequency),
        next(recording.messages(rig_pb2.SignalBlock)),
        state,
        *_identifier_requests(spec, drive),
    ]
    made[0].CopyFrom(spec)
    for message in made:
        _shorten(message)
    return {message.DESCRIPTOR.full_name: message for message in made}


def _identifier_requests(spec: iterator_pb2.CampaignSpec, drive: array_pb2.Record) -> list[Message]:
    identify = identifier_pb2.IdentifyRequest(
        rig=RIG, excitation=spec.excitation, estimator=spec.estimator, run="a", check_only=True
    )
    return [
        identify,
        identifier_pb2.PlanRequest(identify=identify),
        identifier_pb2.LevelsRequest(identify=identify, factors=to_array(np.array([0.5, 1.0]))),
        identifier_pb2.AdviceRequest(model_id=MODEL, target=spec.target, lowest_frequency=1.0, highest_frequency=30.0),
        identifier_pb2.PredictRequest(drive=drive),
        identifier_pb2.ConvergenceRequest(
            iteration_gain=to_array(np.ones(6)), lowest_frequency=1.0, highest_frequency=30.0
        ),
    ]


def _shorten(message: Message) -> None:
    """Cut records to a few seconds: what is checked of them does not depend on their length."""
    for field, value in message.ListFields():
        if field.message_type is None or field.is_repeated:
            continue
        if field.message_type.name == "Record":
            rows, samples = value.samples.shape
            kept = min(samples, int(_KEPT_SECONDS * value.sample_rate))
            data = value.samples.data
            width = len(data) // rows
            value.samples.data = b"".join(data[row * width : row * width + 8 * kept] for row in range(rows))
            value.samples.shape[1] = kept
        else:
            _shorten(value)
