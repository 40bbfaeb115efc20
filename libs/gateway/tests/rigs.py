"""Small rigs of four methods, and a client that plays them on a bus."""

import threading
from contextlib import contextmanager

import numpy as np
import pytest

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_gateway import Approach, GatewayConfig, serving
from duralab_proto.arrays import from_array, from_record, to_record
from duralab_proto.v1 import array_pb2, rig_pb2

RATE = 200.0
WAIT = 60.0
SOON = Approach(ramp=0.1, settle=0.05, ramp_down=0.2, hold=0.05)


class Springs:
    """Two springs in series with nothing; every piece that it was given is kept."""

    def __init__(self, name="springs", **described):
        self.name, self.described = name, described
        self.pieces, self.phases, self.stops, self.resets = [], [], [], 0

    def describe(self):
        told = rig_pb2.RigDescription(
            rig=self.name,
            specimen="two springs",
            engine="none",
            version="1",
            sample_rate=RATE,
            drives=[array_pb2.Channel(name=f"{end}_stroke", unit="m", minimum=-0.1, maximum=0.1) for end in "ab"],
            responses=[array_pb2.Channel(name=f"{end}_force", unit="N", minimum=-1e4, maximum=1e4) for end in "ab"],
            longest_drive_seconds=600.0,
        )
        told.MergeFrom(rig_pb2.RigDescription(**self.described))
        return told

    def play(self, commands, run):
        self.pieces.append(commands)
        self.phases.append(run.phase)
        return 1.0e4 * commands

    def stop(self, reason):
        self.stops.append(reason)

    def reset(self):
        self.resets += 1


class Client:
    def __init__(self, bus, name):
        self.bus, self.name, self.blocks = bus, name, []
        self.arrived = threading.Condition()
        bus.subscribe(bus.keys.rig_signal(name, "*"), rig_pb2.SignalBlock, self._take)
        self.told = self.ask(bus.keys.rig_description, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)

    def _take(self, item):
        with self.arrived:
            self.blocks.append(item.message)
            self.arrived.notify_all()

    def ask(self, key, request, answer=rig_pb2.RigState, **options):
        return self.bus.query(key(self.name), request, answer, **options)

    def request(self, run, drive, *, real_time=False):
        record = to_record(list(self.told.drives), RATE, drive)
        return rig_pb2.PlayRequest(run=run, drive=record, real_time=real_time, seed=3)

    def play(self, run, drive, *, real_time=False, **options):
        request = self.request(run, drive, real_time=real_time)
        result = self.ask(self.bus.keys.rig_play, request, rig_pb2.PlayResult, **options)
        return from_record(result.response)[2]

    def fault(self, *arguments, **options):
        with pytest.raises(FaultError) as caught:
            self.play(*arguments, **options)
        return caught.value

    def state(self):
        return self.ask(self.bus.keys.rig_state, rig_pb2.StateRequest())

    def stop(self, reason="enough"):
        return self.ask(self.bus.keys.rig_stop, rig_pb2.StopRequest(reason=reason))

    def reset(self, **said):
        return self.ask(self.bus.keys.rig_reset, rig_pb2.ResetRequest(**said))

    def published(self, run):
        """Wait for the last block of a run; return its drive, its response and the size of each block."""
        with self.arrived:
            assert self.arrived.wait_for(lambda: any(b.run == run and b.last for b in self.blocks), WAIT)
            blocks = [block for block in self.blocks if block.run == run]
        starts = np.cumsum([0, *(from_array(block.drive).shape[1] for block in blocks)])
        assert [block.first_sample for block in blocks] == list(starts[:-1])
        drive, response = (np.hstack([from_array(getattr(b, of)) for b in blocks]) for of in ("drive", "response"))
        return drive, response, list(np.diff(starts))


@contextmanager
def client_of(rig, *, approach=SOON, **config):
    with (
        open_bus(service="rig_sim") as rig_bus,
        serving(rig_bus, rig, approach=approach, config=GatewayConfig(**config)),
        open_bus(BusConfig(connect=rig_bus.listening), service="client") as bus,
    ):
        bus.wait_for_live({("rig_sim", rig.name)}, WAIT)
        yield Client(bus, rig.name)


def hump(samples=100, size=0.05):
    """A drive that begins and ends at zero."""
    wave = size * np.sin(np.pi * np.arange(samples) / (samples - 1)) ** 2
    wave[-1] = 0.0
    return wave * np.ones((2, 1))
