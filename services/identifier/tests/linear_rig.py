"""Rigs of the contract that are a known linear plant: `python linear_rig.py --config FILE` puts them on the bus.

The rig `rig` of the configuration plays a run whose name contains "slow" for a minute of wall time. Beside the rig
`linear`, `failing` fails at each run, and `mistaken` answers each as another one.
"""

from contextlib import contextmanager

import numpy as np

from duralab.testing import LinearRig
from duralab_bus import service_main
from duralab_gateway import SERVICE, Approach, GatewayConfig, RigFaultError, complete_description, serving
from duralab_proto.arrays import to_record
from duralab_proto.v1 import rig_pb2
from duralab_proto.v1.array_pb2 import CHANNEL_KIND_DISPLACEMENT, CHANNEL_KIND_FORCE, Channel

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
STATIC = np.array([3600.0, -150.0, 20.0])
NOISE = 0.5
SAMPLE_RATE = 1000.0


class LinearRigConfig(GatewayConfig):
    """Configuration of the process."""

    rig: str = "linear"


class KnownRig(LinearRig):
    """The plant of these tests."""

    def __init__(self, name="linear"):
        super().__init__(name, plant=PLANT, drives=DRIVES, responses=RESPONSES, static=STATIC, noise_rms=NOISE)

    def describe(self):
        told = super().describe()
        told.content_hash = "0" * 64
        return told

    def play(self, commands, run):
        if run.real_time:
            run.report("playing in real time")
        if "slow" in run.name:
            run.wait_for_stop(0.1)
        return super().play(commands, run)


def respond(drive):
    """Return the plant's response to a drive from rest, without static part and noise."""
    return KnownRig().respond(drive) - STATIC[:, None]


def true_frf(frequency):
    """Return the plant's FRF matrix, shape (lines, responses, drives)."""
    return KnownRig().sampled_frf(frequency)


class FailingRig(KnownRig):
    """Has no pressure."""

    def play(self, commands, run):
        raise RigFaultError("The rig is interlocked: pressure was lost.")


@contextmanager
def served(bus, config):
    others = [FailingRig("failing")] if config.rig == "linear" else []
    with serving(bus, KnownRig(config.rig), *others, config=config, approach=Approach(ramp=0.0)):
        if others:
            serve_mistaken_rig(bus)
        yield


def serve_mistaken_rig(bus):
    description = complete_description(KnownRig("mistaken").describe())
    answer = rig_pb2.PlayResult(run="another", response=to_record(RESPONSES, SAMPLE_RATE, np.zeros((3, 10))))
    bus.serve(bus.keys.rig_description("mistaken"), rig_pb2.DescriptionRequest, lambda *_: description)
    bus.serve(bus.keys.rig_play("mistaken"), rig_pb2.PlayRequest, lambda *_: answer)
    bus.declare_live(SERVICE, "mistaken")


if __name__ == "__main__":
    service_main(SERVICE, LinearRigConfig, lambda config: lambda bus: served(bus, config), instances=lambda _: ())
