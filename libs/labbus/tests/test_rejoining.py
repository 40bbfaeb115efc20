"""Clients of a router that was away: they come back as other sessions, and with all that was declared."""

import json
import signal
import subprocess
import time

import pytest

import labbus
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0
PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}


class Router:
    """A router in a process of its own that can be away."""

    def __init__(self, processes, endpoint="tcp/127.0.0.1:0"):
        self._processes = processes
        self.process = processes.run("routing_process.py", endpoint, **PIPES)
        self.endpoint = self.process.stdout.readline().strip()

    def config(self, **settings):
        return labbus.BusConfig(mode="client", connect=(self.endpoint,), **settings)

    def leave(self, way):
        self.process.send_signal(way)

    def come_back(self, way):
        if way == signal.SIGSTOP:
            self.process.send_signal(signal.SIGCONT)
        else:
            self.process.wait()
            self.process = self._processes.run("routing_process.py", self.endpoint, **PIPES)


@pytest.fixture
def router(processes):
    return Router(processes)


def ask_for_everything(client):
    assert client.query(client.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState).rig == "bench"
    assert client.query(client.keys.rig_play("bench"), rig_pb2.PlayRequest(run="steps"), rig_pb2.PlayResult).blocks == 5


def test_who_was_cut_off_by_its_router_comes_back_as_another_session_and_lacks_nothing(router, processes, until):
    received = []
    processes.start({"bus": {"mode": "client", "connect": [router.endpoint]}})
    with labbus.open_bus(router.config(), service="test") as client:
        client.wait_for_live({("rig_sim", "bench")}, WAIT)
        states = client.publisher(client.keys.rig_state("of_the_test"))
        subscription = client.subscribe(client.keys.rig_state("*"), rig_pb2.RigState, received.append, repair=True)
        names = {client._session.current.zid()}
        for way in (signal.SIGSTOP, signal.SIGKILL):
            states.put(rig_pb2.RigState(rig="before"))
            until(lambda: subscription.proof(states.key, states.epoch).received == len(names) * 2 - 1)
            router.leave(way)
            until(lambda: client._session.away)
            # Nobody receives it now, and it is not lost.
            states.put(rig_pb2.RigState(rig="meanwhile"))
            late = client.publisher(client.keys.rig_state("late"))
            late.put(rig_pb2.RigState(rig="late"))
            with pytest.raises(labbus.FaultError, match=f"The router at {router.endpoint} is away") as raised:
                client.query(client.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)
            assert raised.value.code == query_pb2.FAULT_CODE_UNAVAILABLE
            until(lambda: not client.live())
            router.come_back(way)
            client.wait_for_live({("rig_sim", "bench")}, WAIT)
            names.add(client._session.current.zid())
            ask_for_everything(client)
            until(lambda: subscription.proof(states.key, states.epoch).received == len(names) * 2 - 2)
            until(lambda late=late: subscription.proof(late.key, late.epoch).received == 1)
        assert len(names) == 3
        of_the_test = [item.message.rig for item in received if item.key == states.key]
        assert of_the_test == ["before", "meanwhile", "before", "meanwhile"]
        assert client.live() == {("rig_sim", "bench")}


def test_a_stream_through_a_router_that_freezes_arrives_whole(router, processes, until, tmp_path):
    seqs = []
    settings = {"endpoint": router.endpoint, "mode": "client", "spool": str(tmp_path), "count": 400, "pause": 0.01}
    with labbus.open_bus(router.config(), service="recorder") as recorder:
        recorder.declare_live("recorder", "main")
        key = recorder.keys.rig_signal("bench", "faults.1")
        blocks = recorder.subscribe(key, rig_pb2.SignalBlock, lambda item: seqs.append(item.seq), repair=True)
        rig = processes.run("publishing_process.py", json.dumps({**settings, "closes": True}), **PIPES)
        epoch = int(rig.stdout.readline())
        until(lambda: seqs)
        router.leave(signal.SIGSTOP)
        until(lambda: recorder._session.away)
        router.come_back(signal.SIGSTOP)
        until(lambda: blocks.proof(key, epoch).complete)
        assert seqs == list(range(400))


def test_who_leaves_while_its_router_is_away_does_so_at_once(router, until):
    client = labbus.open_bus(router.config(), service="test")
    client.serve(client.keys.rig_state("bench"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState())
    client.declare_live("rig_sim", "bench")
    router.leave(signal.SIGKILL)
    until(lambda: client._session.away)
    began = time.monotonic()
    client.close()
    assert time.monotonic() - began < 3.0
    with pytest.raises(labbus.BusError, match="closed"):
        client.query(client.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)


def test_a_link_that_zenoh_takes_up_again_itself_stays_with_its_session(hub, until):
    with labbus.open_bus(labbus.BusConfig(mode="client", connect=hub.listening), service="test") as client:
        name = client._session.current.zid()
        # The second is looked at once the first was done with.
        for _ in range(2):
            client._session._broken.set()
            until(lambda: not client._session._broken.is_set())
        assert not client._session.away
        assert client._session.current.zid() == name
