"""Messages of a small campaign: two drives, two responses, two seconds at 100 Hz."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.message import Message

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2
from recorder.format import Step, decode_step

# What tests of this folder share lies beside them.
sys.path.insert(0, str(Path(__file__).parent))

SAMPLE_RATE = 100.0
SAMPLES = 200
BLOCK = 50
CHANNELS = ("left_vertical", "right_vertical")
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
PLATE = rig_pb2.MeshShape(vertices=to_array(np.eye(3)), corners=[0, 1, 2])


class Campaign:
    """Makes the messages of one campaign."""

    def __init__(self, name: str = "demo") -> None:
        self.name = name
        self.rig = "front_axle"
        time = np.arange(SAMPLES) / SAMPLE_RATE
        self.target = np.stack([np.sin(2 * np.pi * 3 * time), 0.5 * np.cos(2 * np.pi * 5 * time)]) * 1000
        self.drives = [array_pb2.Channel(name=name, unit="m", minimum=-0.1, maximum=0.1) for name in CHANNELS]
        self.responses = [array_pb2.Channel(name=name, unit="N", minimum=-1e4, maximum=1e4) for name in CHANNELS]

    def specification(self) -> iterator_pb2.CampaignSpec:
        return iterator_pb2.CampaignSpec(
            id=self.name,
            rig=self.rig,
            target=to_record(self.responses, SAMPLE_RATE, self.target),
            scenario="road: belgian block\n",
            lowest_frequency=1.0,
            highest_frequency=20.0,
        )

    def description(self) -> rig_pb2.RigDescription:
        return rig_pb2.RigDescription(
            rig=self.rig,
            sample_rate=SAMPLE_RATE,
            drives=self.drives,
            responses=self.responses,
            static_response=to_array(np.zeros(2)),
            bodies=["piston", "wheel"],
            shapes=[
                rig_pb2.RigShape(
                    name="rod",
                    body="piston",
                    role=rig_pb2.SHAPE_ROLE_PISTON,
                    pose=to_array(STILL),
                    cylinder=rig_pb2.CylinderShape(radius=0.1, length=0.6),
                ),
                rig_pb2.RigShape(
                    name="rim",
                    body="wheel",
                    role=rig_pb2.SHAPE_ROLE_SPECIMEN,
                    pose=to_array(STILL),
                    box=rig_pb2.BoxShape(x=0.5, y=0.2, z=0.5),
                ),
                rig_pb2.RigShape(name="ball", pose=to_array(STILL), sphere=rig_pb2.SphereShape(radius=0.05)),
                rig_pb2.RigShape(name="plate", pose=to_array(STILL), mesh=PLATE),
            ],
            links=[
                rig_pb2.RigLink(
                    name="left_vertical",
                    kind=rig_pb2.LINK_KIND_STRUT,
                    point_a=to_array(np.array([0.0, 0.0, -1.0])),
                    body_b="wheel",
                    point_b=to_array(np.zeros(3)),
                )
            ],
            rest_poses=to_array(np.array([STILL, STILL + np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0])])),
        )

    def poses(self, run: str, *, lift: float = 0.1) -> rig_pb2.PoseBlock:
        """The wheel goes up by `lift` within the run, the piston stays."""
        time = np.arange(0.0, SAMPLES / SAMPLE_RATE, 0.1)
        poses = np.tile(STILL, (len(time), 2, 1))
        poses[:, 1, 2] = 0.8 + lift * time / time[-1]
        return rig_pb2.PoseBlock(run=run, time=to_array(time), poses=to_array(poses))

    def state(self, mode: rig_pb2.RigMode, *, reason: str = "", run: str = "") -> rig_pb2.RigState:
        return rig_pb2.RigState(rig=self.rig, mode=mode, reason=reason, run=run)

    def target_in_band(self) -> iterator_pb2.TargetInBand:
        return iterator_pb2.TargetInBand(samples=to_array(self.target))

    def planned(self, run: str) -> recorder_pb2.RunPlanned:
        return recorder_pb2.RunPlanned(run=run, rig=self.rig, purpose="iteration")

    def played(self, run: str, *, epoch: int, blocks: int = SAMPLES // BLOCK) -> recorder_pb2.RunPlayed:
        return recorder_pb2.RunPlayed(run=run, rig=self.rig, epoch=epoch, blocks=blocks)

    def blocks(
        self, run: str, gain: float | np.ndarray = 0.9, drive_gain: float | np.ndarray = 1e-6
    ) -> list[rig_pb2.SignalBlock]:
        return [
            rig_pb2.SignalBlock(
                run=run,
                first_sample=first,
                sample_rate=SAMPLE_RATE,
                drive=to_array(np.ascontiguousarray(self.target[:, first : first + BLOCK] * drive_gain)),
                response=to_array(np.ascontiguousarray(self.target[:, first : first + BLOCK] * gain)),
                last=first + BLOCK >= SAMPLES,
            )
            for first in range(0, SAMPLES, BLOCK)
        ]

    def model(self) -> identifier_pb2.Model:
        frequency = np.linspace(0, SAMPLE_RATE / 2, 65)
        frf = (np.eye(2) + 0.1) * (1 / (1 + 1j * frequency / 8))[:, None, None] * 1e5
        model = identifier_pb2.Model(
            drives=self.drives,
            responses=self.responses,
            frequency=to_array(frequency),
            frf=to_array(frf),
            coherence=to_array(np.full((65, 2), 0.9)),
        )
        model.excitation.spectrum.lowest_frequency = 1.0
        model.excitation.spectrum.highest_frequency = 30.0
        return model

    def metrics(self, iteration: int, error: float) -> iterator_pb2.IterationMetrics:
        return iterator_pb2.IterationMetrics(
            iteration=iteration,
            channels=[
                iterator_pb2.ChannelMetrics(channel=name, relative_rms_error=error, rms_response=1 - error)
                for name in CHANNELS
            ],
            overall_relative_rms_error=error,
        )

    def iteration(self, iteration: int, error: float) -> iterator_pb2.IterationStep:
        response = self.target * (1 - error)
        return iterator_pb2.IterationStep(
            iteration=iteration,
            run=f"{self.name}.i{iteration:02d}",
            drive=to_record(self.drives, SAMPLE_RATE, self.target * 1e-6),
            response=to_record(self.responses, SAMPLE_RATE, response),
            response_in_band=to_array(response),
            metrics=self.metrics(iteration, error),
        )

    def status(self, phase: iterator_pb2.CampaignPhase) -> iterator_pb2.CampaignStatus:
        return iterator_pb2.CampaignStatus(id=self.name, phase=phase, activity="playing", fraction=0.5)


@pytest.fixture
def campaign() -> Campaign:
    return Campaign()


@pytest.fixture
def make_campaign() -> type[Campaign]:
    return Campaign


@pytest.fixture
def request_of() -> Callable[..., recorder_pb2.CommitRequest]:
    def make(number: int, message: Message, *, recording: str = "demo") -> recorder_pb2.CommitRequest:
        return recorder_pb2.CommitRequest(
            recording=recording,
            step=number,
            message_type=message.DESCRIPTOR.full_name,
            payload=message.SerializeToString(),
        )

    return make


@pytest.fixture
def step_of(request_of: Callable[..., recorder_pb2.CommitRequest]) -> Callable[[int, Message], Step]:
    return lambda number, message: decode_step(request_of(number, message))


@pytest.fixture
def rerun_program() -> str:
    import rerun_cli

    return str(Path(rerun_cli.__file__).parent / "rerun")


@pytest.fixture
def viewer_environment(tmp_path: Path) -> dict[str, str]:
    """An own home, so that nothing of the user's is read or written, and no usage reports."""
    import os

    return {**os.environ, "HOME": str(tmp_path), "CI": "1"}
