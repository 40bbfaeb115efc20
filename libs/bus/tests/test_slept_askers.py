"""A query whose asker did not run for a while: what it could not hear is not the silence of the service."""

from queue import Empty
from types import SimpleNamespace

import pytest

from duralab_bus import FaultError
from duralab_bus.queries import client
from duralab_proto.v1 import query_pb2

SILENCE = 10.0


class Events:
    """Events of a query: each wait takes as long as it may and some more, `answer` comes after `waits` of them."""

    def __init__(self, clock, *, late_seconds, answer_after):
        self._clock, self._late, self._left = clock, late_seconds, answer_after

    def get(self, timeout):
        self._left -= 1
        if self._left < 0:
            return self.answer
        self._clock.now += timeout + self._late
        raise Empty

    answer = client._Ended()


@pytest.fixture
def follow(monkeypatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(client.time, "monotonic", lambda: clock.now)

    def run(*, cancel, late_seconds, answer_after):
        question = SimpleNamespace(
            deadline=clock.now + SILENCE,
            silence_seconds=SILENCE,
            cancel=cancel,
            expect_wanted=lambda: None,
            asks=1,
            instance=("rig_sim", "axle"),
            key="rig_sim/play/axle",
        )
        asking = object.__new__(client.QueryClient)
        events = Events(clock, late_seconds=late_seconds, answer_after=answer_after)
        return asking._follow(events, SimpleNamespace(answered=False), question)

    return run


@pytest.mark.parametrize("cancel", [None, object()])
def test_an_answer_that_came_while_the_asker_slept_is_taken(follow, cancel):
    assert follow(cancel=cancel, late_seconds=3 * SILENCE, answer_after=1) is Events.answer


@pytest.mark.parametrize("cancel", [None, object()])
def test_a_service_that_is_silent_while_the_asker_runs_is_silent(follow, cancel):
    with pytest.raises(FaultError, match="was silent for 10 s") as caught:
        follow(cancel=cancel, late_seconds=0.01, answer_after=10_000)
    assert caught.value.code == query_pb2.FAULT_CODE_DEADLINE_EXCEEDED
