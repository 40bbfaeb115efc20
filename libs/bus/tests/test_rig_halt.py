"""A rig counts as being at rest when nothing moves it any more, not as soon as it is latched."""

import pytest

from duralab_bus.commanding import rig_halt
from duralab_proto.v1 import rig_pb2

MOVING = rig_pb2.RigState(rig="rig", mode=rig_pb2.RIG_MODE_INTERLOCKED, reason="gone", run="mine")
RESTING = rig_pb2.RigState(rig="rig", mode=rig_pb2.RIG_MODE_INTERLOCKED, reason="gone")


class Keys:
    def rig_state(self, rig):
        return f"{rig}/state"

    def rig_stop(self, rig):
        return f"{rig}/stop"


class Bus:
    """A rig that says its states one after another, the last one for good; notes what else is asked of it."""

    keys = Keys()

    def __init__(self, *states, goes_on=False):
        self._states = list(states)
        self._goes_on = goes_on
        self.asked = []

    def live(self, *_):
        return {("rig_sim", "rig")}

    def query(self, key, _request, _answer, **_):
        self.asked.append(key)
        if key.endswith("stop") and not self._goes_on:
            return RESTING
        return self._states.pop(0) if len(self._states) > 1 else self._states[0]


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(rig_halt.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(rig_halt.time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))


def halted(bus):
    return rig_halt.bring_to_rest(bus, "rig", run="mine", reason="the campaign was stopped")


def test_a_latched_rig_is_waited_for_until_its_ramp_has_ended():
    bus = Bus(MOVING, MOVING, MOVING, RESTING)
    assert halted(bus) == ""
    assert bus.asked == ["rig/state"] * 4


@pytest.mark.parametrize("mode", [rig_pb2.RIG_MODE_SETTLING, rig_pb2.RIG_MODE_PLAYING, rig_pb2.RIG_MODE_RAMPING_DOWN])
def test_a_rig_that_goes_on_is_stopped(mode):
    bus = Bus(rig_pb2.RigState(rig="rig", mode=mode, run="mine"))
    assert halted(bus) == ""
    assert bus.asked[-1] == "rig/stop"


def test_what_others_play_is_left_alone():
    bus = Bus(rig_pb2.RigState(rig="rig", mode=rig_pb2.RIG_MODE_PLAYING, run="theirs"))
    assert halted(bus) == ""
    assert "rig/stop" not in bus.asked


def test_a_rig_that_goes_on_after_its_stop_is_never_taken_for_one_that_rests():
    bus = Bus(MOVING, goes_on=True)
    assert halted(bus) == "the run 'mine' cannot be stopped and goes on to its end, and rig is latched from then on"
    assert rig_halt.latch_rig(bus, "rig", run="mine", reason="enough") == halted(bus)


@pytest.mark.parametrize(("run", "stopped"), [("", True), ("mine", True), ("theirs", False)])
def test_a_stop_latches_the_rig_whatever_it_does_but_for_the_run_of_somebody_else(run, stopped):
    bus = Bus(rig_pb2.RigState(rig="rig", mode=rig_pb2.RIG_MODE_IDLE, run=run))
    trouble = rig_halt.latch_rig(bus, "rig", run="mine", reason="enough")
    assert ("rig/stop" in bus.asked) is stopped
    assert ("'theirs'" in trouble) is not stopped
