"""Endurance tests on a real bus: played to their end, held, decided, stopped."""

import time
from collections import Counter

import numpy as np
import pytest

from duralab_bus import FaultError, RecordingLog
from duralab_proto.arrays import from_array
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2, sequencer_pb2

from .counting_rig import RIG
from .disturbed_test import ENDED, recorded_steps, repeat_of, specification, volumes
from .killable_services import KillableServices

PER_RECORDING = 16


@pytest.fixture(scope="module")
def services(tmp_path_factory):
    settings = {
        "sequencer": {"repeats_per_recording": PER_RECORDING},
        "rig_sim": {"crack_repeat": 40, "crack": 0.5},
    }
    with KillableServices(tmp_path_factory.mktemp("endurance"), settings=settings) as running:
        yield running
        assert running.defects() == []


def ask(services, key, request):
    return services.bus.query(key, request, sequencer_pb2.EnduranceStatus)


def status_of(services, id):
    return ask(services, services.bus.keys.endurance(id), sequencer_pb2.EnduranceRequest())


def wait_for(services, id, fits, seconds=60.0):
    until = time.monotonic() + seconds
    while not fits(status := status_of(services, id)):
        assert time.monotonic() < until, status
        time.sleep(0.02)
    return status


def started(services, id, *, repeats, extra=""):
    spec = specification(services, id, repeats=repeats, extra=extra)
    ask(services, services.bus.keys.endurance_start(RIG), spec)
    return spec


def steps_of(services, id, kind):
    return [message for message in recorded_steps(services, id) if isinstance(message, kind)]


def reset_rig(services):
    bus = services.bus
    bus.query(bus.keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)


def holding(status):
    return status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING


def ended(status):
    return status.phase in ENDED


def test_every_repeat_is_played_once_and_recorded_in_recordings_of_bounded_size(services):
    spec = started(services, "whole", repeats=36)
    status = wait_for(services, "whole", ended)
    assert (status.phase, status.played, status.unknown) == (sequencer_pb2.ENDURANCE_PHASE_FINISHED, 36, 0)
    repeats = steps_of(services, "whole", sequencer_pb2.EnduranceRepeat)
    assert [repeat.repeat for repeat in repeats] == list(range(36))
    played = [run for run in services.ledger.read_text().split() if run.startswith("whole.r")]
    assert played == [repeat.run for repeat in repeats]
    assert volumes(services, "whole") == ["whole", "whole-v0002", "whole-v0003"]
    for recording in volumes(services, "whole"):
        key = services.bus.keys.recording_verify(recording)
        result = services.bus.query(key, recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult)
        assert list(result.findings) == []
    # The damage is that of the repeats, summed by hand.
    counted = sum(from_array(repeat.damage, field="damage") for repeat in repeats)
    np.testing.assert_allclose(from_array(status.damage, field="damage"), counted, rtol=1e-12)
    assert Counter(repeat.event for repeat in repeats) == {0: 24, 1: 12}
    # By the rule: the first two of each event, and no more.
    assert status.kept == 4
    kept = [repeat for repeat in repeats if repeat.samples_hash]
    assert [repeat.repeat for repeat in kept] == [0, 1, 2, 4]
    blocks = steps_of(services, "whole", recorder_pb2.RunPlayed)
    assert [played.run for played in blocks] == [repeat.run for repeat in kept]
    assert spec.id == "whole"


def test_a_window_of_a_kept_repeat_is_what_the_rig_answered(services):
    bus = services.bus
    request = recorder_pb2.SignalWindowRequest(run="whole.r0000000", seconds=10.0)
    window = bus.query(bus.keys.recording_signals("whole"), request, recorder_pb2.SignalWindow)
    repeat = steps_of(services, "whole", sequencer_pb2.EnduranceRepeat)[0]
    response = from_array(window.response.samples, field="samples")
    statistics = from_array(repeat.statistics, field="statistics", finite=False)
    np.testing.assert_array_equal(statistics[:, 0], response.min(axis=1))
    np.testing.assert_array_equal(statistics[:, 1], response.max(axis=1))


def test_a_name_that_is_recorded_is_refused(services):
    with pytest.raises(FaultError, match="never overwritten"):
        started(services, "whole", repeats=3)


def test_a_hold_waits_before_the_next_repeat_until_it_is_resumed(services):
    started(services, "held", repeats=30)
    wait_for(services, "held", lambda status: status.played >= 3)
    ask(services, services.bus.keys.endurance_hold("held"), sequencer_pb2.HoldEnduranceRequest(reason="lunch"))
    status = wait_for(services, "held", holding)
    assert "lunch" in status.hold.reason
    assert status.hold.next_repeat == status.played
    ledger = services.ledger.read_text()
    time.sleep(0.3)
    assert services.ledger.read_text() == ledger
    ask(services, services.bus.keys.endurance_resume("held", RIG), sequencer_pb2.ResumeEnduranceRequest())
    assert wait_for(services, "held", ended).phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    repeats = steps_of(services, "held", sequencer_pb2.EnduranceRepeat)
    assert [repeat.repeat for repeat in repeats] == list(range(30))


def test_a_stop_ends_it_latches_the_rig_and_counts_what_was_broken_off(services):
    started(services, "stopped", repeats=100_000)
    wait_for(services, "stopped", lambda status: status.played >= 2)
    status = ask(services, services.bus.keys.endurance_stop("stopped"), sequencer_pb2.StopEnduranceRequest(reason="x"))
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_STOPPED
    bus = services.bus
    state = bus.query(bus.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)
    assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
    begun = [run for run in services.ledger.read_text().split() if run.startswith("stopped.r")]
    repeats = steps_of(services, "stopped", sequencer_pb2.EnduranceRepeat)
    assert len(repeats) >= len(begun)
    with pytest.raises(FaultError, match="has ended"):
        ask(services, bus.keys.endurance_resume("stopped", RIG), sequencer_pb2.ResumeEnduranceRequest())
    reset_rig(services)


def test_a_recording_that_lacks_only_its_end_is_closed_by_the_resume_that_is_refused(services):
    # As a sequencer leaves it that is killed between the last two steps.
    bus, spec = services.bus, specification(services, "ended", repeats=3)
    log = RecordingLog(bus, spec.id)
    log.commit(spec)
    log.commit(sequencer_pb2.EnduranceVolume(id=spec.id, rig=RIG, number=1))
    phase = sequencer_pb2.ENDURANCE_PHASE_FINISHED
    log.commit(sequencer_pb2.EnduranceStatus(id=spec.id, rig=RIG, phase=phase, activity="finished after 3 repeats"))
    with pytest.raises(FaultError, match=r"has ended \(finished after 3 repeats\); start a new one"):
        ask(services, bus.keys.endurance_resume(spec.id, RIG), sequencer_pb2.ResumeEnduranceRequest())
    assert steps_of(services, spec.id, recorder_pb2.RecordingClosed)[0].reason == "finished after 3 repeats"
    key = bus.keys.recording_verify(spec.id)
    assert not bus.query(key, recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult).findings


def test_a_rig_that_is_latched_between_two_repeats_makes_it_hold_and_nothing_is_counted(services):
    started(services, "latched", repeats=2000, extra="keep: {first: 0, every: null}")
    wait_for(services, "latched", lambda status: status.played >= 3)
    ask(services, services.bus.keys.endurance_hold("latched"), sequencer_pb2.HoldEnduranceRequest())
    played = wait_for(services, "latched", holding).played
    bus = services.bus
    bus.query(bus.keys.rig_stop(RIG), rig_pb2.StopRequest(reason="a hose"), rig_pb2.RigState)
    with pytest.raises(FaultError, match="a hose"):
        ask(services, bus.keys.endurance_resume("latched", RIG), sequencer_pb2.ResumeEnduranceRequest())
    reset_rig(services)
    ask(services, bus.keys.endurance_resume("latched", RIG), sequencer_pb2.ResumeEnduranceRequest())
    wait_for(services, "latched", lambda status: status.played >= played + 3)
    ask(services, bus.keys.endurance_stop("latched"), sequencer_pb2.StopEnduranceRequest())
    reset_rig(services)
    repeats = [repeat_of(run) for run in services.ledger.read_text().split() if run.startswith("latched.r")]
    assert repeats == sorted(set(repeats))


def test_a_crack_makes_it_hold_with_the_samples_around_and_a_decision_lets_it_go_on(services):
    started(services, "cracked", repeats=60, extra="keep: {first: 1, every: null, around_alarm: 3}")
    status = wait_for(services, "cracked", lambda status: holding(status) or ended(status))
    assert holding(status), status
    alarm = status.hold.alarms[0]
    assert alarm.level == sequencer_pb2.ALARM_LEVEL_ABORT
    assert alarm.channel == "force_1"
    assert 40 <= alarm.repeat <= 43
    bus = services.bus
    with pytest.raises(FaultError) as refused:
        ask(services, bus.keys.endurance_resume("cracked", RIG), sequencer_pb2.ResumeEnduranceRequest())
    assert (refused.value.code, refused.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "hold")
    decision = sequencer_pb2.EnduranceDecision(
        hold=status.hold.number, kind=sequencer_pb2.ENDURANCE_DECISION_KIND_CONTINUE, name="Ada", reason="on purpose"
    )
    key = bus.keys.endurance_decide("cracked", RIG)
    nameless = sequencer_pb2.EnduranceDecision(hold=decision.hold, kind=decision.kind, reason="on purpose")
    with pytest.raises(FaultError, match="name has 0 characters"):
        ask(services, key, nameless)
    ask(services, key, decision)
    while not ended(status := status_of(services, "cracked")):
        if holding(status):
            decision.hold = status.hold.number
            ask(services, key, decision)
        time.sleep(0.02)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    before = [samples.repeat for samples in steps_of(services, "cracked", sequencer_pb2.RepeatSamples)]
    first = alarm.repeat
    assert before[:4] == [first - 3, first - 2, first - 1, first]
    after = [r.repeat for r in steps_of(services, "cracked", sequencer_pb2.EnduranceRepeat) if r.samples_hash]
    assert set(range(first + 1, first + 4)) <= set(after) | set(before)
    decided = steps_of(services, "cracked", sequencer_pb2.EnduranceDecision)
    assert decided[0].name == "Ada"
