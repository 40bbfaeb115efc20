"""The diagrams of the contract: they are drawn from the tables, and a rig on the bus does what they show."""

from __future__ import annotations

import importlib.util
import re
import threading
from itertools import pairwise

import numpy as np
import pytest

from duralab.testing import LinearRig
from duralab_bus import BusConfig, FaultError, open_bus
from duralab_gateway import Approach, serving
from duralab_proto.arrays import to_record
from duralab_proto.v1 import rig_pb2

from .documented import ROOT

_spec = importlib.util.spec_from_file_location("contract_pictures", ROOT / "scripts" / "site" / "contract_pictures.py")
assert _spec is not None
assert _spec.loader is not None
drawn = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(drawn)

STATE_OF = {(mode, moving): name for name, (mode, moving, *_) in drawn.STATES.items()}


class WatchedRig:
    """A linear rig on a bus, and the states that it publishes, each once."""

    def __init__(self, bus):
        self.bus = bus
        self.states = []
        self.changed = threading.Condition()
        keys = bus.keys
        bus.subscribe(keys.rig_state("linear"), rig_pb2.RigState, self._take, repair=True)
        bus.wait_for_live({("rig_sim", "linear")}, 60.0)
        self.description = bus.query(
            keys.rig_description("linear"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
        )

    def _take(self, item):
        name = STATE_OF[rig_pb2.RigMode.Name(item.message.mode), bool(item.message.run)]
        with self.changed:
            if self.states[-1:] != [name]:
                self.states.append(name)
                self.changed.notify_all()

    def play(self, run, *, seconds=1.0, ends_at_zero=False):
        drive = np.full((2, int(seconds * 1000)), 0.001)
        if ends_at_zero:
            drive *= np.hanning(drive.shape[1])
        request = rig_pb2.PlayRequest(
            run=run, drive=to_record(self.description.drives, 1000.0, drive), real_time=not ends_at_zero
        )
        return self.bus.query(self.bus.keys.rig_play("linear"), request, rig_pb2.PlayResult)

    def wait_for(self, state, *, after=0):
        with self.changed:
            assert self.changed.wait_for(lambda: state in self.states[after:], 60.0), (state, self.states)

    def stop(self):
        request = rig_pb2.StopRequest(reason="a test")
        return self.bus.query(self.bus.keys.rig_stop("linear"), request, rig_pb2.RigState)

    def reset(self):
        return self.bus.query(self.bus.keys.rig_reset("linear"), rig_pb2.ResetRequest(), rig_pb2.RigState)


@pytest.fixture
def rig():
    approach = Approach(ramp=0.5, settle=0.2, ramp_down=0.5)
    with (
        open_bus(BusConfig(), service="rig_sim") as served,
        serving(served, LinearRig(), approach=approach),
        open_bus(BusConfig(connect=served.listening), service="test") as bus,
    ):
        yield WatchedRig(bus)


def modes_in(name):
    return [found[1] for step in drawn.SEQUENCES[name][1] if (found := re.match(r"RigState: (\w+)", step.text))]


def test_the_pictures_are_what_the_tables_give():
    for name, content in drawn.pictures().items():
        assert (ROOT / "docs" / "pictures" / name).read_text(encoding="utf-8") == content, (
            f"{name} is not fresh; run python scripts/site/contract_pictures.py"
        )


def test_every_mode_is_drawn_and_every_picture_is_shown():
    modes = {name for name, _ in rig_pb2.RigMode.items() if not name.endswith("UNSPECIFIED")}
    assert {mode for mode, *_ in drawn.STATES.values()} == modes
    page = (ROOT / "docs" / "contract.md").read_text(encoding="utf-8")
    assert [name for name in drawn.pictures() if f"(pictures/{name})" not in page] == []


def test_a_playback_goes_through_the_states_as_drawn(rig):
    rig.play("whole")
    rig.wait_for("idle")
    assert [drawn.STATES[state][0].removeprefix("RIG_MODE_") for state in rig.states] == modes_in("call_play")
    before = len(rig.states)
    rig.play("back-at-zero", ends_at_zero=True)
    rig.wait_for("idle", after=before)
    assert rig.states[before:] == ["settling", "playing", "idle"]
    assert set(pairwise(rig.states)) <= set(drawn.TRANSITIONS)


@pytest.mark.parametrize("state", ["settling", "playing", "ramping down"])
def test_a_stop_latches_from_every_state_as_drawn(rig, state):
    faults = []

    def play():
        try:
            rig.play("stopped")
        except FaultError as fault:
            faults.append(fault.code_name)

    commander = threading.Thread(target=play)
    commander.start()
    rig.wait_for(state)
    answer = rig.stop()
    commander.join(60.0)
    assert (answer.mode, answer.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "")
    # On its way back all was played, so that the playback is answered all the same.
    assert faults == ([] if state == "ramping down" else ["CANCELLED"])
    rig.wait_for("latched, at rest")
    assert rig.states[-3:] == [state, "latched, moving", "latched, at rest"]
    assert len(modes_in("call_stop")) == 2
    rig.reset()
    rig.wait_for("idle")
    assert set(pairwise(rig.states)) <= set(drawn.TRANSITIONS)


def test_a_stop_of_a_rig_at_rest_latches_it_as_drawn(rig):
    rig.stop()
    rig.reset()
    rig.wait_for("idle")
    assert rig.states == ["latched, at rest", "idle"]
    assert ("idle", "latched, at rest") in drawn.TRANSITIONS
