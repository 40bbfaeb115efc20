"""Liveliness: who comes and goes is seen, and short flaps are not."""

import queue
import signal
import threading
import time

import pytest

import duralab_bus
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0


def test_service_is_seen_coming_and_being_killed(hub, processes):
    events = queue.SimpleQueue()
    hub._tracker.subscribe(lambda *event: events.put(event))
    process = processes.start({"bus": {"connect": list(hub.listening)}, "rigs": ["one", "two"]})
    assert {events.get(timeout=WAIT) for _ in range(2)} == {("rig_sim", "one", True), ("rig_sim", "two", True)}
    assert hub.live() == hub.live("rig_sim") == {("rig_sim", "one"), ("rig_sim", "two")}
    assert hub.live(instance="two") == {("rig_sim", "two")}
    process.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    assert {events.get(timeout=WAIT) for _ in range(2)} == {("rig_sim", "one", False), ("rig_sim", "two", False)}
    # Its connection told, not the lease of 10 s that runs out.
    assert time.monotonic() - killed < 8.0
    assert hub.live() == set()


def test_frozen_service_is_gone_for_those_who_wait_and_back_when_it_thaws(hub, processes):
    events, faults = queue.SimpleQueue(), queue.SimpleQueue()
    process = processes.start({"bus": {"connect": list(hub.listening)}})
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    hub._tracker.subscribe(lambda *event: events.put(event))
    assert events.get(timeout=WAIT) == ("rig_sim", "bench", True)

    def ask():
        try:
            hub.query(hub.keys.rig_play("bench"), rig_pb2.PlayRequest(run="freeze.1"), rig_pb2.PlayResult)
        except duralab_bus.FaultError as fault:
            faults.put(fault.code)

    began = time.monotonic()
    # It stops itself, as soon as it has the query.
    asking = threading.Thread(target=ask)
    asking.start()
    assert events.get(timeout=WAIT) == ("rig_sim", "bench", False)
    assert faults.get(timeout=WAIT) == query_pb2.FAULT_CODE_UNAVAILABLE
    # Neither Zenoh's own lease of 10 s nor the silence of 10 s that a query allows.
    assert time.monotonic() - began < 8.0
    asking.join()
    process.send_signal(signal.SIGCONT)
    assert events.get(timeout=WAIT) == ("rig_sim", "bench", True)
    assert hub.query(hub.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState).rig == "bench"


def test_service_whose_native_code_keeps_python_busy_is_not_taken_for_frozen(hub, bench):
    events = queue.SimpleQueue()
    hub._tracker.subscribe(lambda *event: events.put(event))
    assert events.get(timeout=WAIT) == ("rig_sim", "bench", True)
    # 4 s without the interpreter: twice what a link waits for a sign of life.
    result = hub.query(hub.keys.rig_play("bench"), rig_pb2.PlayRequest(run="hold.1"), rig_pb2.PlayResult)
    assert result.run == "hold.1"
    assert events.empty()


def test_late_watcher_is_told_who_is_there_already(hub):
    token = hub.declare_live("recorder", "main")
    hub.wait_for_live({("recorder", "main")}, WAIT)
    events = queue.SimpleQueue()
    hub._tracker.subscribe(lambda *event: events.put(event))
    assert events.get(timeout=WAIT) == ("recorder", "main", True)
    token.close()
    assert events.get(timeout=WAIT) == ("recorder", "main", False)


def test_flap_is_not_reported(hub):
    token = hub.declare_live("recorder", "main")
    events = queue.SimpleQueue()
    hub._tracker.subscribe(lambda *event: events.put(event))
    assert events.get(timeout=WAIT) == ("recorder", "main", True)
    token.close()
    token = hub.declare_live("recorder", "main")
    with pytest.raises(queue.Empty):
        events.get(timeout=0.6)
    token.close()


def test_new_session_discovers_who_was_there_before(lab):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=lab.listening), service="late") as late:
        assert late.discover() == {("rig_sim", "bench")}


def test_sessions_of_one_hub_meet_each_other(lab):
    # Gossip: the second one is told of the first by the hub, and linked to it directly.
    config = duralab_bus.BusConfig(connect=lab.listening)
    with duralab_bus.open_bus(config, service="a") as a, duralab_bus.open_bus(config, service="b") as b:
        a.declare_live("iterator", "main")
        b.wait_for_live({("iterator", "main")}, WAIT)


def test_labs_do_not_meet(lab):
    with duralab_bus.open_bus(
        duralab_bus.BusConfig(connect=lab.listening, lab="other"), service="stranger"
    ) as stranger:
        assert stranger.discover() == set()


def test_who_is_missing_is_named(lab):
    wanted = {("rig_sim", "bench"), ("recorder", "main"), ("iterator", "main")}
    with pytest.raises(duralab_bus.FaultError) as caught:
        lab.wait_for_live(wanted, 0.1)
    assert caught.value.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert "iterator/main, recorder/main" in caught.value.message
    assert "bench" not in caught.value.message
