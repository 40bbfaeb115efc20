"""A hold waits for one decision: who brings it is answered when it is stored, all others are refused."""

import threading

import pytest

from duralab_bus import FaultError, OpenHold
from duralab_proto.v1 import query_pb2


class _Call:
    def progress(self, phase: str, fraction: float, *, detail: str = "") -> None:
        pass


def _late() -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "It is not open.")


def _brought_by_another(hold: OpenHold[str, str], name: str, decision: str) -> tuple[threading.Thread, list[object]]:
    answers: list[object] = []

    def bring() -> None:
        try:
            answers.append(hold.bring(name, decision, _Call(), not_open=_late))
        except FaultError as error:
            answers.append(error)

    thread = threading.Thread(target=bring)
    thread.start()
    return thread, answers


def test_a_decision_is_answered_after_it_is_stored_and_a_second_one_is_refused():
    hold, stored = OpenHold[str, str](threading.Event()), []
    hold.open(first := "first")
    thread, answers = _brought_by_another(hold, first, "play")

    def store(decision: str) -> None:
        assert not answers
        with pytest.raises(FaultError, match="not open"):
            hold.bring(first, "end", _Call(), not_open=_late)
        stored.append(decision)

    assert hold.decided(store) == "play"
    thread.join()
    assert (stored, answers, hold.hold) == (["play"], [None], None)


def test_who_brings_a_decision_is_told_why_it_could_not_be_stored():
    hold = OpenHold[str, str](threading.Event())
    hold.open(only := "only")
    thread, answers = _brought_by_another(hold, only, "play")

    def store(decision: str) -> None:
        raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, "No recorder.")

    with pytest.raises(FaultError, match="No recorder"):
        hold.decided(store)
    thread.join()
    assert str(answers[0]) == "No recorder."


def test_a_stop_ends_the_waiting_and_later_decisions_are_refused():
    stop = threading.Event()
    hold = OpenHold[str, str](stop)
    hold.open(name := "hold")
    stop.set()
    with pytest.raises(FaultError, match="Stopped on request"):
        hold.decided(lambda decision: None)
    with pytest.raises(FaultError, match="not open"):
        hold.bring(name, "play", _Call(), not_open=_late)


def test_a_decision_on_an_earlier_hold_is_refused():
    hold = OpenHold[str, str](threading.Event())
    hold.open(before := "before")
    hold.open("now")
    with pytest.raises(FaultError, match="not open"):
        hold.bring(before, "play", _Call(), not_open=_late)
    assert hold.hold == "now"
