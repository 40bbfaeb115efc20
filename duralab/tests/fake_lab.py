"""The four services as fakes: the keys, messages and process behaviour of the real ones, with nothing behind them."""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import synthetic_campaign
from pydantic import ConfigDict

from duralab_bus import Bus, FaultError, ServiceConfig, service_main
from duralab_proto.arrays import from_record, to_record
from duralab_proto.keys import id_of, rig_of
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2

ROAD = tuple(f"{side}_{what}" for side in ("left", "right") for what in ("height", "slope", "camber", "speed"))


class AnyConfig(ServiceConfig):
    """What the real services take, unchecked."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    rigs: tuple[str, ...] = ("front_axle", "predecessor")
    folder: str = ""
    spool_folder: str | None = None
    viewer: str | None = None
    real_time: bool = False


def describe(rig: str) -> rig_pb2.RigDescription:
    description = synthetic_campaign.description(rig)
    if rig == "predecessor":
        del description.drives[:]
        for name in ROAD:
            description.drives.add(name=name, unit="m", minimum=-50.0, maximum=50.0)
    return description


def play(request: rig_pb2.PlayRequest, call, *, real_time: bool) -> rig_pb2.PlayResult:
    """Answer with a fixed mixture of the drives, so that a test can compute what must come back."""
    channels, rate, drive = from_record(request.drive, field="drive")
    wanted = describe(rig_of(call.key)).drives
    if [c.name for c in channels] != [c.name for c in wanted]:
        raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, "The drive has other channels.", field="drive.channels")
    beyond = [c.name for c, row in zip(wanted, drive, strict=True) if np.abs(row).max() > c.maximum]
    if beyond:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT, f"{beyond[0]} exceeds its limit.", field="drive.samples"
        )
    call.progress("playing", 0.5, remaining_seconds=1.0)
    if os.environ.get("FAKE_RIG") == "hang":
        time.sleep(600)
    return rig_pb2.PlayResult(
        run=request.run,
        response=to_record(synthetic_campaign.response_channels(), rate, response_to(drive)),
        actuators=[rig_pb2.ActuatorUse(drive=c.name, peak_command_ratio=0.5) for c in wanted],
        epoch=1,
        blocks=1,
        real_time_factor=1.0 if real_time or request.real_time else 100.0,
    )


def state(request: rig_pb2.StateRequest, call) -> rig_pb2.RigState:
    """Say that the vehicle's rig is latched, and the other one rests."""
    del request
    if rig_of(call.key) == "predecessor":
        return rig_pb2.RigState(rig="predecessor", mode=rig_pb2.RIG_MODE_INTERLOCKED, reason="A hose [/left] is loose.")
    return rig_pb2.RigState(rig=rig_of(call.key), mode=rig_pb2.RIG_MODE_IDLE)


def response_to(drive: np.ndarray) -> np.ndarray:
    return 1e4 * (np.eye(6) + 0.1) @ drive[:6]


def build_rig_sim(config: AnyConfig):
    def build(bus: Bus) -> None:
        for rig in config.rigs:
            bus.serve(
                bus.keys.rig_description(rig), rig_pb2.DescriptionRequest, lambda _, call: describe(rig_of(call.key))
            )
            bus.serve(bus.keys.rig_play(rig), rig_pb2.PlayRequest, partial(play, real_time=config.real_time))
            bus.serve(bus.keys.rig_state(rig), rig_pb2.StateRequest, state)

    return build


def build_identifier(bus: Bus) -> None:
    made = synthetic_campaign.make(seconds=4.0, iterations=2)
    model = next(step for step in synthetic_campaign.steps(made) if isinstance(step, identifier_pb2.Model))

    def identify(request: identifier_pb2.IdentifyRequest, call) -> identifier_pb2.Model:
        del request
        call.progress("exciting the rig", 0.5, remaining_seconds=1.0)
        return model

    bus.serve(bus.keys.identify("*"), identifier_pb2.IdentifyRequest, identify)


def final_status(id: str, *, iterations: int) -> iterator_pb2.CampaignStatus:
    made = synthetic_campaign.make(seconds=4.0, iterations=iterations)
    return iterator_pb2.CampaignStatus(
        id=id,
        phase=iterator_pb2.CAMPAIGN_PHASE_FINISHED,
        activity="finished",
        fraction=1.0,
        iterations=[synthetic_campaign.metrics(made, row) for row in range(iterations)],
        outcome=iterator_pb2.OUTCOME_ITERATIONS_USED,
        best_iteration=iterations,
    )


class FakeIterator:
    """Runs a campaign in some tenths of a second; FAKE_ITERATOR says how it ends: finish, fault, die or stay."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._status: dict[str, iterator_pb2.CampaignStatus] = {}
        bus.serve(bus.keys.campaign_start("*"), iterator_pb2.CampaignSpec, self.start)
        bus.serve(bus.keys.campaign("*"), iterator_pb2.CampaignRequest, lambda _, call: self._status[id_of(call.key)])
        bus.serve(bus.keys.campaign_stop("*"), iterator_pb2.StopCampaignRequest, self.stop)

    def start(self, spec: iterator_pb2.CampaignSpec, call) -> iterator_pb2.CampaignStatus:
        self._status[spec.id] = iterator_pb2.CampaignStatus(
            id=spec.id,
            phase=iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING,
            activity=f"identifying the rig{' in real time' if spec.real_time else ''}",
            fraction=0.2,
        )
        threading.Thread(target=self._run, args=(spec,), daemon=True).start()
        return self._status[spec.id]

    def stop(self, request: iterator_pb2.StopCampaignRequest, call) -> iterator_pb2.CampaignStatus:
        if record := os.environ.get("FAKE_STOPPED"):
            Path(record).write_text(request.reason)
        return self._status[id_of(call.key)]

    def _run(self, spec: iterator_pb2.CampaignSpec) -> None:
        publisher = self._bus.publisher(self._bus.keys.campaign_event(spec.id))
        publisher.put(iterator_pb2.CampaignEvent(status=self._status[spec.id]))
        match os.environ.get("FAKE_ITERATOR", "finish"):
            case "die":
                os._exit(7)
            case "stay":
                return
            case "fault":
                status = iterator_pb2.CampaignStatus(
                    id=spec.id,
                    phase=iterator_pb2.CAMPAIGN_PHASE_FAULTED,
                    fault=query_pb2.Fault(message="The rig is interlocked: it met a limit.", service="rig_sim"),
                )
            case _:
                status = final_status(spec.id, iterations=spec.stop.iterations)
        self._status[spec.id] = status
        publisher.put(iterator_pb2.CampaignEvent(status=status))


class FakeRecorder:
    """Holds one recording, under whatever name it is asked for."""

    def __init__(self, bus: Bus) -> None:
        made = synthetic_campaign.make(seconds=4.0, iterations=2)
        with tempfile.TemporaryDirectory() as folder:
            path = synthetic_campaign.write(Path(folder) / "r.mcap", synthetic_campaign.steps(made))
            self._parts = {"recording": path.read_bytes(), "live": b"RRF2 not really"}
        bus.serve(bus.keys.recordings(), recorder_pb2.ListRecordingsRequest, self.list)
        bus.serve(bus.keys.recording("*"), recorder_pb2.RecordingRequest, self.describe)
        bus.serve(bus.keys.recording_read("*"), recorder_pb2.ReadRecordingRequest, self.read)

    def list(self, request, call) -> recorder_pb2.RecordingList:
        names = os.environ.get("FAKE_RECORDINGS", "").split()
        return recorder_pb2.RecordingList(recordings=[recorder_pb2.RecordingInfo(recording=n) for n in names])

    def describe(self, request, call) -> recorder_pb2.RecordingInfo:
        digest = hashlib.sha256(self._parts["recording"]).hexdigest()
        if os.environ.get("FAKE_RECORDER") == "corrupt":
            digest = "0" * 64
        return recorder_pb2.RecordingInfo(recording=id_of(call.key), closed=True, file_hash=digest)

    def read(self, request: recorder_pb2.ReadRecordingRequest, call) -> recorder_pb2.RecordingPart:
        content = self._parts[request.part]
        piece = content[request.offset : request.offset + request.length]
        return recorder_pb2.RecordingPart(offset=request.offset, data=piece, total=len(content))


def main(name: str) -> None:
    builders = {
        "rig_sim": build_rig_sim,
        "identifier": lambda _: build_identifier,
        "iterator": lambda _: lambda bus: (FakeIterator(bus), None)[1],
        "recorder": lambda _: lambda bus: (FakeRecorder(bus), None)[1],
    }
    instances = (lambda config: config.rigs) if name == "rig_sim" else (lambda _: ("main",))
    service_main(name, AnyConfig, builders[name], instances=instances)
