"""Longest time of a repeat: short on a simulated rig, which waits for nothing; elsewhere, long enough for a person."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from duralab_proto.arrays import to_record
from duralab_proto.keys import Keys
from duralab_proto.v1 import array_pb2, rig_pb2, sequencer_pb2
from sequencer.endurance import rig_playback

RATE, SECONDS = 100.0, 10.0
DRIVE = np.zeros((1, round(RATE * SECONDS)))
WEEK = 7 * 24 * 3600.0


class PlayingBus:
    """Stands for a bus whose rig answers each repeat after a time by `clock`."""

    def __init__(self, description, clock, *, takes):
        self.keys = Keys()
        self.asked = []
        self._description, self._clock, self._takes = description, clock, iter(takes)

    def query(self, _key, request, answer, *, silence_seconds, longest_seconds, cancel):
        del cancel
        assert silence_seconds == 60.0
        self.asked.append(longest_seconds)
        self._clock.now += next(self._takes)
        return answer(run=request.run, response=to_record(self._description.responses, RATE, DRIVE))


@pytest.fixture
def longest(monkeypatch):
    """Return the longest time that each of a few repeats is given, which take so many seconds."""

    def ask(*, simulated, takes):
        clock = SimpleNamespace(now=100.0)
        monkeypatch.setattr(rig_playback.time, "monotonic", lambda: clock.now)
        channel = array_pb2.Channel(name="a", unit="m")
        description = rig_pb2.RigDescription(
            rig="r", sample_rate=RATE, drives=[channel], responses=[channel], simulated=simulated
        )
        bus = PlayingBus(description, clock, takes=takes)
        plan = SimpleNamespace(description=description, spec=sequencer_pb2.EnduranceSpec(rig="r"))
        playback = rig_playback.RigPlayback(bus, plan, cancel=threading.Event())
        for repeat, _ in enumerate(takes):
            playback.play(DRIVE, run=f"t.r{repeat}", repeat=repeat)
        return bus.asked

    return ask


def test_a_repeat_of_a_real_rig_may_wait_a_week_for_a_person(longest):
    assert longest(simulated=False, takes=[12.0, 12.0]) == [WEEK + 2 * SECONDS] * 2


def test_a_repeat_of_a_simulated_rig_may_take_twenty_times_as_long_as_the_slowest(longest):
    # Quicker than real time, then thrice as slow as real time.
    assert longest(simulated=True, takes=[0.1, 30.0, 0.1]) == [WEEK + 20.0, 230.0, 630.0]
