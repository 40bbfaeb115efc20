"""A rig served on a real bus, and a client that plays it and keeps all that it says."""

import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

import duralab_bus
from duralab_gateway import SERVICE, RigServer
from duralab_proto.arrays import from_array, to_record
from duralab_proto.v1 import rig_pb2
from rig_sim.bus import SimulatedRig

RIG = "front_axle_compliant"
WAIT = 120.0


def wave(seconds, size=0.03, rows=6):
    time_ = np.arange(round(1000 * seconds)) / 1000.0
    return size * np.sin(2 * np.pi * 1.5 * time_) * np.minimum(time_, 1.0) * np.ones((rows, 1))


class Client:
    def __init__(self, bus):
        self.bus, self.blocks, self.arrived, self.states = bus, [], [], []
        self.changed = threading.Condition()
        bus.subscribe(bus.keys.rig_signal(RIG, "*"), rig_pb2.SignalBlock, self._on_block)
        bus.subscribe(bus.keys.rig_state(RIG), rig_pb2.RigState, self._on_state)
        self.told = bus.query(bus.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)

    def _on_block(self, item):
        now = time.monotonic()
        with self.changed:
            self.blocks.append(item.message)
            self.arrived.append(now)
            self.changed.notify_all()

    def _on_state(self, item):
        with self.changed:
            self.states.append(item.message)
            self.changed.notify_all()

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, WAIT)

    def play(self, run, drive, *, real_time=False, **options):
        record = to_record(self.told.drives, 1000.0, drive)
        request = rig_pb2.PlayRequest(run=run, drive=record, real_time=real_time, seed=1)
        return self.bus.query(self.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult, **options)

    def fault(self, *arguments, **options):
        with pytest.raises(duralab_bus.FaultError) as caught:
            self.play(*arguments, **options)
        return caught.value

    def ask(self, key, request):
        return self.bus.query(key, request, rig_pb2.RigState)

    def state(self):
        return self.ask(self.bus.keys.rig_state(RIG), rig_pb2.StateRequest())

    def stop(self, reason="enough"):
        return self.ask(self.bus.keys.rig_stop(RIG), rig_pb2.StopRequest(reason=reason))

    def reset(self):
        return self.ask(self.bus.keys.rig_reset(RIG), rig_pb2.ResetRequest())

    def drive_of(self, run):
        self.wait_for(lambda: any(block.run == run and block.last for block in self.blocks))
        return np.hstack([from_array(block.drive) for block in self.blocks if block.run == run])


@contextmanager
def served(rig, *, real_time=False):
    with duralab_bus.open_bus(service=SERVICE) as server_bus:
        server = RigServer(
            server_bus, SimulatedRig(rig), duralab_bus.SpoolSpace(2**26), spool_wait_seconds=1.0, real_time=real_time
        )
        server_bus.declare_live(SERVICE, RIG)
        with duralab_bus.open_bus(duralab_bus.BusConfig(connect=tuple(server_bus.listening)), service="client") as bus:
            bus.wait_for_live({(SERVICE, RIG)}, WAIT)
            client = Client(bus)
            client.server = server
            yield client
        server.close()
