"""A rig of the contract that is a known linear plant: `python linear_rig.py --config FILE` puts it on the bus.

A run whose name contains "slow" plays for a minute of wall time, one that contains "interlock" trips it, and one that
contains "mistaken" is answered as another one.
"""

import time
from collections.abc import Callable

import numpy as np
from scipy import signal

from duralab_proto.arrays import from_record, to_array, to_record
from duralab_proto.v1 import query_pb2, rig_pb2
from duralab_proto.v1.array_pb2 import CHANNEL_KIND_DISPLACEMENT, CHANNEL_KIND_FORCE, Channel
from labbus import Bus, Call, FaultError, ServiceConfig, service_main

SAMPLE_RATE = 1000.0
STATIC = np.array([3600.0, -150.0, 20.0])
NOISE = 0.5
BLOCK = 100
# (numerator, denominator) of each response to each drive, N per m.
PLANT = [
    [([2e4, 1e4], [1.0, -1.7, 0.8]), ([0.0, 5e3], [1.0, -0.5])],
    [([1e4], [1.0, -1.2, 0.6]), ([3e4, -2e4], [1.0, -1.6, 0.75])],
    [([0.0, 0.0, 3e4], [1.0, -0.3]), ([-2e4], [1.0, -0.9])],
]
DRIVES = [
    Channel(name=name, unit="m", kind=CHANNEL_KIND_DISPLACEMENT, minimum=-0.1, maximum=0.1)
    for name in ("left_vertical", "right_vertical")
]
RESPONSES = [
    Channel(name=name, unit="N", kind=CHANNEL_KIND_FORCE, minimum=-1e5, maximum=1e5)
    for name in ("left_force", "right_force", "middle_force")
]


class LinearRigConfig(ServiceConfig):
    """Configuration of the rig."""

    rig: str = "linear"


def respond(drive: np.ndarray) -> np.ndarray:
    """Return the plant's response to a drive from rest, without static part and noise."""
    return np.stack([sum(signal.lfilter(*cell, drive[j]) for j, cell in enumerate(row)) for row in PLANT])


def true_frf(frequency: np.ndarray) -> np.ndarray:
    """Return the plant's FRF matrix, shape (lines, responses, drives)."""
    rows = [[signal.freqz(*cell, worN=2 * np.pi * frequency / SAMPLE_RATE)[1] for cell in row] for row in PLANT]
    return np.asarray(rows).transpose(2, 0, 1)


class LinearRig:
    """Serves description and play, and publishes the signal of each run."""

    def __init__(self, bus: Bus, rig: str) -> None:
        self._bus = bus
        self._rig = rig
        bus.serve(bus.keys.rig_description(rig), rig_pb2.DescriptionRequest, self.describe)
        bus.serve(bus.keys.rig_play(rig), rig_pb2.PlayRequest, self.play)

    def describe(self, _request: rig_pb2.DescriptionRequest, _call: Call) -> rig_pb2.RigDescription:
        """Answer what the rig is."""
        return rig_pb2.RigDescription(
            rig=self._rig,
            specimen="a linear plant",
            engine="filter",
            version="1",
            sample_rate=SAMPLE_RATE,
            drives=DRIVES,
            responses=RESPONSES,
            longest_drive_seconds=600.0,
            static_response=to_array(STATIC),
            block_samples=BLOCK,
            content_hash="0" * 64,
        )

    def play(self, request: rig_pb2.PlayRequest, call: Call) -> rig_pb2.PlayResult:
        """Play a drive and answer the response."""
        if "interlock" in request.run:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "The rig is interlocked: pressure was lost.")
        _, _, drive = from_record(request.drive, field="drive")
        noise = NOISE * np.random.default_rng(request.seed).standard_normal((len(RESPONSES), drive.shape[1]))
        response = respond(drive) + STATIC[:, None] + noise
        publisher = self._bus.publisher(self._bus.keys.rig_signal(self._rig, request.run))
        starts = range(0, drive.shape[1], BLOCK)
        for start in starts:
            if call.cancelled:
                raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "The playback was given up.")
            phase = "playing in real time" if request.real_time else "playing"
            call.progress(phase, start / drive.shape[1], remaining_seconds=0.0)
            if "slow" in request.run:
                time.sleep(60.0 / len(starts))
            piece = slice(start, start + BLOCK)
            publisher.put(
                rig_pb2.SignalBlock(
                    run=request.run,
                    first_sample=start,
                    sample_rate=SAMPLE_RATE,
                    drive=to_array(drive[:, piece]),
                    response=to_array(response[:, piece]),
                    last=start == starts[-1],
                )
            )
        publisher.close()
        return rig_pb2.PlayResult(
            run="another" if "mistaken" in request.run else request.run,
            response=to_record(RESPONSES, SAMPLE_RATE, response),
            actuators=[rig_pb2.ActuatorUse(drive=channel.name) for channel in DRIVES],
            epoch=publisher.epoch,
            blocks=len(starts),
            real_time_factor=1000.0,
        )


def _build(config: LinearRigConfig) -> Callable[[Bus], None]:
    def build(bus: Bus) -> None:
        LinearRig(bus, config.rig)

    return build


if __name__ == "__main__":
    # A real rig is live as an instance of rig_sim or of its gateway, which the contract calls by the same name.
    service_main("rig_sim", LinearRigConfig, _build, instances=lambda config: (config.rig,))
