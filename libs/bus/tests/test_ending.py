"""A campaign or an endurance test that ends early says what it did, why it ended, and what became of its rig."""

import pytest

from duralab_bus import FaultError, early_end, halt_rig
from duralab_bus.commanding import ending
from duralab_proto.v1 import query_pb2, sequencer_pb2

FAULT = FaultError(query_pb2.FAULT_CODE_DATA_LOSS, "The response has no samples.", field="response", service="rig_sim")


def ended(stopped=None, **more):
    return early_end(FAULT, what="campaign", step="playing", service="iterator", stopped=stopped, **more)


def test_a_failure_has_the_code_and_the_field_of_its_fault():
    end = ended(remedy="Resume it.")
    assert end.activity == "failed while playing"
    assert end.fault.message == "The campaign failed while playing: The response has no samples. Resume it."
    assert (end.fault.code, end.fault.field, end.fault.service) == (FAULT.code, "response", "rig_sim")


def test_a_stop_is_no_failure_whatever_broke_meanwhile():
    end = ended(stopped="lunch.", remedy="Resume it.")
    assert end.activity == "stopped while playing"
    assert end.fault.message == "The campaign was stopped while playing: lunch."
    assert end.fault.code == query_pb2.FAULT_CODE_CANCELLED


@pytest.mark.parametrize(
    ("run", "latch", "halted"), [("r1", False, "rest"), ("r1", True, "latch"), ("", True, "latch"), ("", False, None)]
)
def test_a_rig_is_latched_if_asked_and_otherwise_brought_to_rest_only_if_it_played(monkeypatch, run, latch, halted):
    calls = []

    def halting(name):
        def halt(_bus, rig, *, run, reason):
            calls.append((name, rig, run, reason))
            return "the rig plays on"

        return halt

    monkeypatch.setattr(ending, "bring_to_rest", halting("rest"))
    monkeypatch.setattr(ending, "latch_rig", halting("latch"))
    final = sequencer_pb2.EnduranceStatus(activity="stopped", fault=query_pb2.Fault(message="It was stopped."))
    halt_rig(None, "axle", final, run=run, reason="enough", latch=latch)
    assert calls == ([(halted, "axle", run, "It was stopped.")] if halted else [])
    assert final.activity == ("stopped; the rig plays on" if halted else "stopped")
    assert final.fault.message == ("It was stopped. The rig plays on." if halted else "It was stopped.")
