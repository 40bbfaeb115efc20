"""Clients of a router that was away: they come back as other sessions, and with all that was declared."""

import ast
import json
import os
import signal
import subprocess
import threading
import time

import pytest

import duralab_bus
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0
RESTARTS = 28 if "DURALAB_LONG_TESTS" in os.environ else 3
PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}


class Router:
    """A router in a process of its own that can be away."""

    def __init__(self, processes, endpoint="tcp/127.0.0.1:0"):
        self._processes = processes
        self.process = processes.run("routing_process.py", endpoint, **PIPES)
        self.endpoint = self.process.stdout.readline().strip()

    def config(self, **settings):
        return duralab_bus.BusConfig(mode="client", connect=(self.endpoint,), **settings)

    def leave(self, way):
        self.process.send_signal(way)

    def come_back(self, way):
        if way == signal.SIGSTOP:
            self.process.send_signal(signal.SIGCONT)
        else:
            self.process.wait()
            self.process = self._processes.run("routing_process.py", self.endpoint, **PIPES)

    def restart(self, away_seconds=0.0):
        """Kill it and start it again as fast as a router of native code starts."""
        spare = self._processes.run("routing_process.py", self.endpoint, "held", **PIPES)
        assert spare.stdout.readline() == "held\n"
        self.leave(signal.SIGKILL)
        self.process.wait()
        time.sleep(away_seconds)
        self.process = spare
        spare.stdin.write("\n")
        spare.stdin.flush()


@pytest.fixture
def router(processes):
    return Router(processes)


def ask_for_everything(client):
    assert client.query(client.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState).rig == "bench"
    assert client.query(client.keys.rig_play("bench"), rig_pb2.PlayRequest(run="steps"), rig_pb2.PlayResult).blocks == 5


def test_who_was_cut_off_by_its_router_comes_back_as_another_session_and_lacks_nothing(router, processes, until):
    received = []
    processes.start({"bus": {"mode": "client", "connect": [router.endpoint]}})
    with duralab_bus.open_bus(router.config(), service="test") as client:
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
            with pytest.raises(duralab_bus.FaultError, match=f"The router at {router.endpoint} is away") as raised:
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


class LabClient:
    """Asks one thing over and over on a thread, and keeps the faults."""

    def __init__(self, ask, *, times=10**9):
        self._ask, self._times, self._over = ask, times, threading.Event()
        self.answers, self.faults = 0, []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        for _ in range(self._times):
            if self._over.wait(0.002):
                return
            try:
                self._ask()
            except duralab_bus.FaultError as fault:
                self.faults.append(fault)
            else:
                self.answers += 1

    def end(self):
        self._over.set()
        self._thread.join(WAIT)


def test_no_restart_of_a_router_is_blamed_on_the_rig_and_no_playback_is_asked_twice(router, processes, until):
    processes.start({"bus": {"mode": "client", "connect": [router.endpoint]}})
    runs = iter(range(10**9))
    with duralab_bus.open_bus(router.config(), service="test") as client:
        client.wait_for_live({("rig_sim", "bench")}, WAIT)
        state, play = client.keys.rig_state("bench"), client.keys.rig_play("bench")
        reads = LabClient(lambda: client.query(state, rig_pb2.StateRequest(), rig_pb2.RigState))
        plays = LabClient(
            lambda: client.query(play, rig_pb2.PlayRequest(run=f"steps.{next(runs)}"), rig_pb2.PlayResult)
        )
        for number in range(RESTARTS):
            before, refused = client._session.current, len(reads.faults)
            # Some so short that Zenoh has the link back, some long enough for another session.
            router.restart(away_seconds=0.3 * (number % 3 == 2))
            seen = reads.answers, plays.answers
            until(lambda seen=seen: reads.answers > seen[0] + 5 and plays.answers > seen[1] + 5)
            if client._session.current is before:
                # A read outlasts that.
                assert reads.faults[refused:] == []
        reads.end()
        plays.end()
        for fault in (*reads.faults, *plays.faults):
            assert fault.code_name == "UNAVAILABLE", fault.message
            assert f"he router at {router.endpoint}" in fault.message
        for fault in plays.faults:
            assert "nothing was sent" in fault.message or "unknown whether the request" in fault.message
        calls = ast.literal_eval(client.query(state, rig_pb2.StateRequest(), rig_pb2.RigState).reason)
        assert set(calls.values()) == {1}


@pytest.mark.parametrize(
    ("key", "request_message", "response"),
    [
        ("rig_state", rig_pb2.StateRequest(), rig_pb2.RigState(rig="bench")),
        ("rig_play", rig_pb2.PlayRequest(run="once"), rig_pb2.PlayResult(run="once")),
    ],
)
def test_a_query_that_its_router_cuts_off_is_asked_again_if_it_reads_and_not_if_it_moves(
    router, until, key, request_message, response
):
    asked, released = [], threading.Event()

    def handle(_request, call):
        asked.append(call.key)
        if len(asked) == 1:
            released.wait(WAIT)
        return response

    with (
        duralab_bus.open_bus(router.config(), service="rig_sim") as rig,
        duralab_bus.open_bus(router.config(), service="test") as client,
    ):
        key = getattr(client.keys, key)("bench")
        rig.serve(key, type(request_message), handle)
        rig.declare_live("rig_sim", "bench")
        client.wait_for_live({("rig_sim", "bench")}, WAIT)
        began = client._session.current
        asking = LabClient(lambda: client.query(key, request_message, type(response)), times=1)
        until(lambda: asked)
        router.restart()
        asking.end()
        released.set()
        rejoined = client._session.away or client._session.current is not began
        for fault in asking.faults:
            assert fault.code_name == "UNAVAILABLE"
            assert f"he router at {router.endpoint}" in fault.message
        if isinstance(response, rig_pb2.PlayResult):
            assert "unknown whether the request" in asking.faults[0].message
            assert asked == [key]
        elif not rejoined:
            assert asking.answers == 1
            assert len(asked) >= 2


@pytest.mark.parametrize("key", ["rig_frf", "rig_reset"])
def test_a_young_session_names_a_key_that_is_not_served(router, processes, key):
    processes.start({"bus": {"mode": "client", "connect": [router.endpoint]}})
    with duralab_bus.open_bus(router.config(), service="test") as client:
        client.wait_for_live({("rig_sim", "bench")}, WAIT)
        with pytest.raises(duralab_bus.FaultError, match="is on the bus but does not answer") as raised:
            client.query(getattr(client.keys, key)("bench"), rig_pb2.ResetRequest(), rig_pb2.RigState)
        assert raised.value.code == query_pb2.FAULT_CODE_UNIMPLEMENTED


def test_a_read_that_its_service_drops_is_asked_again_until_the_connection_is_whole_and_a_change_is_not(router):
    asked = []

    def drop(query):
        asked.append(str(query.key_expr))
        query.drop()

    with (
        duralab_bus.open_bus(router.config(), service="rig_sim") as rig,
        duralab_bus.open_bus(router.config(), service="test") as client,
    ):
        state, play = client.keys.rig_state("bench"), client.keys.rig_play("bench")
        dropping = [rig._session.current.declare_queryable(key, drop, complete=True) for key in (state, play)]
        rig.declare_live("rig_sim", "bench")
        client.wait_for_live({("rig_sim", "bench")}, WAIT)
        with pytest.raises(duralab_bus.FaultError, match=r"unknown whether the request .* not sent again") as raised:
            client.query(play, rig_pb2.PlayRequest(run="once"), rig_pb2.PlayResult)
        assert raised.value.code == query_pb2.FAULT_CODE_UNAVAILABLE
        # Served, and no answer though the connection is whole: not an unserved key.
        with pytest.raises(duralab_bus.FaultError, match="without a result") as raised:
            client.query(state, rig_pb2.StateRequest(), rig_pb2.RigState)
        assert raised.value.code == query_pb2.FAULT_CODE_DATA_LOSS
        assert asked.count(play) == 1
        # Each wait is longer than the one before, up to 0.4 s, and all of them take 3 s at most.
        assert 2 <= asked.count(state) <= 10
        for queryable in dropping:
            queryable.undeclare()


def test_a_stream_through_a_router_that_freezes_arrives_whole(router, processes, until, tmp_path):
    seqs = []
    settings = {"endpoint": router.endpoint, "mode": "client", "spool": str(tmp_path), "count": 400, "pause": 0.01}
    with duralab_bus.open_bus(router.config(), service="recorder") as recorder:
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
    client = duralab_bus.open_bus(router.config(), service="test")
    client.serve(client.keys.rig_state("bench"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState())
    client.declare_live("rig_sim", "bench")
    router.leave(signal.SIGKILL)
    until(lambda: client._session.away)
    began = time.monotonic()
    client.close()
    assert time.monotonic() - began < 3.0
    with pytest.raises(duralab_bus.BusError, match="closed"):
        client.query(client.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)


def test_a_link_that_zenoh_takes_up_again_itself_stays_with_its_session(hub, until):
    with duralab_bus.open_bus(duralab_bus.BusConfig(mode="client", connect=hub.listening), service="test") as client:
        name = client._session.current.zid()
        # The second is looked at once the first was done with.
        for _ in range(2):
            client._session._broken.set()
            until(lambda: not client._session._broken.is_set())
        assert not client._session.away
        assert client._session.current.zid() == name
