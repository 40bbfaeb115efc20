"""May the rig play: one at a time, not twice under one name, not while latched."""

import threading

import pytest

import duralab_gateway.interlock
from duralab_bus import FaultError
from duralab_gateway.interlock import LONGEST_REASON, Interlock
from duralab_proto.v1 import rig_pb2


@pytest.fixture
def interlock():
    return Interlock("bench")


def refused(interlock, run):
    with pytest.raises(FaultError) as caught:
        interlock.begin(run)
    return caught.value


def test_a_playback_takes_the_rig_and_gives_it_back(interlock):
    assert interlock.state() == rig_pb2.RigState(rig="bench", mode=rig_pb2.RIG_MODE_IDLE)
    interlock.begin("a")
    assert interlock.state() == rig_pb2.RigState(rig="bench", mode=rig_pb2.RIG_MODE_SETTLING, run="a")
    interlock.enter(rig_pb2.RIG_MODE_PLAYING)
    interlock.fraction = 0.25
    assert interlock.state() == rig_pb2.RigState(rig="bench", mode=rig_pb2.RIG_MODE_PLAYING, run="a", fraction=0.25)
    interlock.end()
    assert interlock.state() == rig_pb2.RigState(rig="bench", mode=rig_pb2.RIG_MODE_IDLE)


def test_one_playback_at_a_time_and_no_name_twice(interlock):
    interlock.begin("a")
    assert (refused(interlock, "b").code_name, "plays run 'a'" in str(refused(interlock, "b"))) == ("BUSY", True)
    interlock.end()
    fault = refused(interlock, "a")
    assert (fault.code_name, fault.field) == ("ALREADY_EXISTS", "run")
    interlock.begin("b")


def test_the_memory_of_names_is_bounded(interlock, monkeypatch):
    monkeypatch.setattr(duralab_gateway.interlock, "REMEMBERED_RUNS", 3)
    for number in range(5):
        interlock.begin(f"run{number}")
        interlock.end()
    assert refused(interlock, "run2").code_name == "ALREADY_EXISTS"
    interlock.begin("run0")


def test_a_latched_rig_refuses_with_the_first_reason(interlock):
    interlock.trip("oil on the floor")
    interlock.trip("once more")
    fault = refused(interlock, "a")
    assert fault.code_name == "FAILED_PRECONDITION"
    assert str(fault) == "bench is interlocked (oil on the floor); reset it before it plays."
    interlock.reset(seen=interlock.trips)
    interlock.begin("a")
    assert interlock.state().reason == ""
    assert not interlock.wait_for_stop(0.0)


def test_a_stop_is_heard_by_what_plays_and_outlives_it(interlock):
    interlock.begin("a")
    threading.Timer(0.05, interlock.trip, ["enough"]).start()
    assert interlock.wait_for_stop(120.0)
    assert (interlock.state().mode, interlock.state().run) == (rig_pb2.RIG_MODE_INTERLOCKED, "a")
    interlock.end()
    assert (interlock.state().mode, interlock.state().run) == (rig_pb2.RIG_MODE_INTERLOCKED, "")


def test_rest_is_waited_for(interlock):
    interlock.begin("a")
    interlock.trip("enough")
    threading.Timer(0.1, interlock.end).start()
    assert interlock.wait_for_rest().run == ""


def test_a_rig_that_does_not_come_to_rest_is_told_of(interlock, monkeypatch):
    monkeypatch.setattr(duralab_gateway.interlock, "REST_SECONDS", 0.05)
    interlock.begin("a")
    with pytest.raises(FaultError, match=r"run 'a' has not reached rest in 0\.05 s") as caught:
        interlock.wait_for_rest()
    assert caught.value.code_name == "DEADLINE_EXCEEDED"


def test_a_stop_without_a_reason_or_with_a_novel_is_a_stop(interlock):
    interlock.trip("")
    assert interlock.state().reason == "stopped on request"
    interlock.reset(seen=interlock.trips)
    interlock.trip("x" * 10_000_000)
    assert interlock.state().reason == "x" * LONGEST_REASON + "…"


def test_a_stop_while_a_reset_waits_is_not_erased(interlock):
    interlock.begin("a")
    interlock.trip("first")
    asked = interlock.trips
    interlock.trip("somebody is in the cell")
    interlock.end()
    with pytest.raises(FaultError) as caught:
        interlock.reset(seen=asked)
    assert caught.value.code_name == "FAILED_PRECONDITION"
    assert str(caught.value) == (
        "bench was stopped again while its reset waited (somebody is in the cell); see to it and reset it again."
    )
    assert (interlock.state().mode, interlock.state().reason) == (rig_pb2.RIG_MODE_INTERLOCKED, "first")
    assert interlock.wait_for_stop(0.0)
    interlock.reset(seen=interlock.trips)
    assert interlock.state().mode == rig_pb2.RIG_MODE_IDLE


def test_a_reset_is_done_once(interlock, monkeypatch):
    interlock.claim("first")
    with pytest.raises(FaultError, match="'first' of bench was done before") as caught:
        interlock.claim("first")
    assert (caught.value.code_name, caught.value.field) == ("ALREADY_EXISTS", "command")
    monkeypatch.setattr(duralab_gateway.interlock, "REMEMBERED_RUNS", 2)
    for command in ("second", "third"):
        interlock.claim(command)
    # The memory is bounded, and a run may have the name that a reset had.
    interlock.claim("first")
    interlock.begin("first")
