"""Queries on reserved workers wait instead of being refused; what is closed leaves nothing behind."""

import threading
import time

import pytest
import zenoh

import duralab_bus
from duralab_proto.v1 import rig_pb2

WAIT = 120.0


def ask_at_once(bus, count, *, reason="now"):
    """Ask for so many stops at the same time; return their answers or faults."""
    answers = []

    def ask():
        try:
            answers.append(
                bus.query(bus.keys.rig_stop("bench"), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState).rig
            )
        except duralab_bus.FaultError as fault:
            answers.append(fault.message)

    threads = [threading.Thread(target=ask) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT)
    return answers


def test_two_stops_at_once_are_both_answered_without_waiting_for_each_other(lab):
    # The rig answers neither before it has both.
    assert ask_at_once(lab, 2, reason="together") == ["bench", "bench"]


def test_more_stops_than_workers_are_queued_and_not_refused(lab):
    assert ask_at_once(lab, 7) == ["bench"] * 7


def test_asker_whose_token_flapped_before_its_query_is_not_cancelled(hub):
    cancelled = []

    def handle(_request, call):
        cancelled.append(call.cancelled)
        return rig_pb2.RigState()

    key = hub.keys.rig_stop("r")
    hub.serve(key, rig_pb2.StopRequest, handle)
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="asker") as asker:
        asker.discover()
        tokens = asker._session.current.liveliness()
        tokens.declare_token(hub.keys.asking("flapping")).undeclare()
        wait_for(lambda: "flapping" in hub._server._departed)
        token = tokens.declare_token(hub.keys.asking("flapping"))
        wait_for(lambda: "flapping" not in hub._server._departed)
        encoding = duralab_bus.encoding_of(rig_pb2.StopRequest)
        replies = asker._session.current.get(
            key, encoding=encoding, attachment="flapping", consolidation=zenoh.ConsolidationMode.NONE, timeout=60.0
        )
        assert [reply.ok is not None for reply in replies] == [True]
        token.undeclare()
    assert cancelled == [False]


@pytest.mark.parametrize("there", [True, False])
def test_asker_that_left_once_is_looked_for_before_its_query_is_cancelled(hub, there):
    key = hub.keys.rig_stop("r")
    hub.serve(key, rig_pb2.StopRequest, lambda *_: rig_pb2.RigState(rig="r"))
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="asker") as asker:
        asker.discover()
        session = asker._session.current
        if there:
            token = session.liveliness().declare_token(hub.keys.asking("back"))
        # As after a link that broke: that the token is back has not been told yet.
        hub._server._departed.append("back")
        encoding = duralab_bus.encoding_of(rig_pb2.StopRequest)
        replies = session.get(
            key, encoding=encoding, attachment="back", consolidation=zenoh.ConsolidationMode.NONE, timeout=60.0
        )
        assert [reply.ok is not None for reply in replies] == [there]
        assert ("back" in hub._server._departed) is not there
        if there:
            token.undeclare()


def test_closed_subscriptions_tokens_and_keys_are_let_go(hub):
    for _ in range(3):
        hub.subscribe(hub.keys.rig_state("r"), rig_pb2.RigState, lambda _: None).close()
        hub.declare_live("rig_sim", "r").close()
        served = hub.serve(hub.keys.rig_stop("r"), rig_pb2.StopRequest, lambda *_: rig_pb2.RigState(), workers=2)
        served.close()
        served.close()
    server = hub._server
    assert [len(kept) for kept in (hub._subscriptions, hub._tokens, server._served, server._routes)] == [0] * 4
    assert server._pools == []


def wait_for(condition):
    until = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)
