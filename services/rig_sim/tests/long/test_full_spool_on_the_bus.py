"""A recorder that stores nothing: the rig waits, ramps down, says why, and what it measured is all still there."""

import threading

import numpy as np
import pytest

import duralab_bus
from duralab_gateway import SERVICE, RigServer
from duralab_proto.arrays import from_array, to_record
from duralab_proto.v1 import query_pb2, rig_pb2
from rig_sim.bus import SimulatedRig

RIG = "front_axle_compliant"
WAIT = 120.0
#: Of about 10 KB each, with an eighth more for the way down.
ROOM_BLOCKS = 100


def drive(seconds):
    time = np.arange(round(1000 * seconds)) / 1000.0
    return 0.005 * np.sin(2 * np.pi * 2.0 * time) * np.ones((6, 1))


class Lab:
    """A rig with a small spool, a recorder that is live and stores when told, and a commander."""

    def __init__(self, rig_bus, bus, rig):
        self.bus, self.items, self.arrived = bus, [], threading.Condition()
        keys = bus.keys
        bus.declare_live("recorder", "main")
        rig_bus.wait_for_live({("recorder", "main")}, WAIT)
        self.space = duralab_bus.SpoolSpace(ROOM_BLOCKS * 10_000)
        self.server = RigServer(rig_bus, SimulatedRig(rig), self.space, spool_wait_seconds=0.3)
        rig_bus.declare_live(SERVICE, RIG)
        bus.wait_for_live({(SERVICE, RIG)}, WAIT)
        self.description = bus.query(keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
        self.subscription = bus.subscribe(keys.rig_signal(RIG, "*"), rig_pb2.SignalBlock, self._take, repair=True)

    def _take(self, item):
        with self.arrived:
            self.items.append(item)
            self.arrived.notify_all()

    def play(self, run, seconds, *, real_time=False):
        record = to_record(self.description.drives, 1000.0, drive(seconds))
        request = rig_pb2.PlayRequest(run=run, drive=record, real_time=real_time)
        return self.bus.query(self.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult)

    def fault(self, *arguments, **options):
        with pytest.raises(duralab_bus.FaultError) as caught:
            self.play(*arguments, **options)
        assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
        return caught.value.message

    def state(self):
        return self.bus.query(self.bus.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)

    def reset(self):
        return self.bus.query(self.bus.keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)

    def blocks_of(self, run):
        """Wait for the whole of a run; return its blocks as they came."""
        with self.arrived:
            assert self.arrived.wait_for(
                lambda: any(item.message.run == run and item.message.last for item in self.items), WAIT
            )
            return [item for item in self.items if item.message.run == run]


@pytest.fixture
def lab(front_axle_compliant):
    with (
        duralab_bus.open_bus(service=SERVICE) as rig_bus,
        duralab_bus.open_bus(duralab_bus.BusConfig(connect=rig_bus.listening), service="client") as bus,
    ):
        lab = Lab(rig_bus, bus, front_axle_compliant)
        yield lab
        lab.server.close()


@pytest.mark.parametrize("real_time", [False, True])
def test_rig_ramps_down_says_why_and_keeps_every_block(lab, real_time):
    if real_time:
        # What earlier playbacks left is in the way, all but a second.
        lab.play("before", 0.1 * (ROOM_BLOCKS * 7 // 8) - 1.0)
    message = lab.fault("full", 60.0, real_time=real_time)
    assert "MiB in memory is full" in message
    assert "see to the recorder" in message
    state = lab.state()
    assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert "is full" in state.reason
    items = lab.blocks_of("full")
    assert [item.seq for item in items] == list(range(len(items)))
    played = np.hstack([from_array(item.message.drive) for item in items])
    assert 0 < played.shape[1] < 60_000
    # All the way down to rest.
    assert np.all(played[:, -1] == 0.0)
    assert not lab.space.full


def test_a_stop_comes_through_where_its_state_cannot_be_published(lab, monkeypatch):
    def refuse(_state):
        raise duralab_bus.SpoolFullError("the spool is full.")

    monkeypatch.setattr(lab.server._states, "put", refuse)
    keys = lab.bus.keys
    stopped = lab.bus.query(keys.rig_stop(RIG), rig_pb2.StopRequest(reason="enough"), rig_pb2.RigState)
    assert (stopped.mode, stopped.reason) == (rig_pb2.RIG_MODE_INTERLOCKED, "enough")


def test_rig_with_no_room_does_not_move_and_plays_again_once_it_is_stored(lab):
    lab.fault("full", 60.0)
    lab.reset()
    assert lab.fault("next", 1.0).startswith("Nothing was played: ")
    assert lab.state().mode == rig_pb2.RIG_MODE_IDLE
    lab.subscription.mark([item.position for item in lab.blocks_of("full")])
    # The mark is on its way; the rig waits for a moment before it refuses.
    assert lab.play("after", 1.0).blocks == 2


def test_simulation_waits_for_a_recorder_that_stores_late(lab):
    ended = threading.Event()

    def store():
        while not ended.wait(0.05):
            lab.subscription.mark([item.position for item in list(lab.items)])

    thread = threading.Thread(target=store)
    thread.start()
    # Four times what fits.
    result = lab.play("long", 0.4 * ROOM_BLOCKS)
    assert [item.seq for item in lab.blocks_of("long")] == list(range(result.blocks))
    assert sum(item.message.drive.shape[1] for item in lab.blocks_of("long")) == 4 * 100 * ROOM_BLOCKS
    ended.set()
    thread.join()
