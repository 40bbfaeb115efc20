"""An endurance test of some hundred repeats whose services are killed at seeded moments."""

import time

import pytest
from tests.endurance.counting_rig import RIG
from tests.endurance.disturbed_test import DisturbedTest, Outcome, recorded_steps, specification
from tests.endurance.killable_services import SERVICES, KillableServices

from duralab_proto.v1 import sequencer_pb2


@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_lost_or_played_twice_through_ten_kills(tmp_path, seed):
    repeats = 400
    settings = {"sequencer": {"repeats_per_recording": 64}}
    with KillableServices(tmp_path, settings=settings) as services:
        outcome = Outcome(repeats)
        DisturbedTest(services, specification(services, "long", repeats=repeats), outcome).run(
            kill_every=36, seed=seed, victims=SERVICES
        )
    assert (outcome.lost, outcome.doubled, outcome.findings) == ([], [], [])
    assert sum(outcome.kills.values()) >= 8
    assert set(outcome.kills) == set(SERVICES)
    assert outcome.unknown <= sum(outcome.kills.values())
    # Whatever was killed, the recordings are as many as for a test that nothing happened to.
    assert outcome.recordings == -(-repeats // 64)


def figures(services: KillableServices) -> list[tuple[bytes, ...]]:
    """Return all that makes the result of a test: what was measured of each repeat, and each state of the monitor."""
    found = []
    for step in recorded_steps(services, "same"):
        if isinstance(step, sequencer_pb2.EnduranceRepeat):
            for alarm in step.alarms:
                # The clock of the machine is no result.
                assert alarm.found > 0
                alarm.ClearField("found")
            alarms = b"".join(alarm.SerializeToString(deterministic=True) for alarm in step.alarms)
            found.append((step.run.encode(), step.statistics.data, step.measures.data, step.baseline, alarms))
        if isinstance(step, sequencer_pb2.EnduranceVolume):
            found.append((step.monitor, *step.baselines, *(event.damage.data for event in step.events)))
    return found


def status_of(services: KillableServices) -> sequencer_pb2.EnduranceStatus:
    key = services.bus.keys.endurance("same")
    return services.bus.query(key, sequencer_pb2.EnduranceRequest(), sequencer_pb2.EnduranceStatus)


def wait_for(services: KillableServices, phase: sequencer_pb2.EndurancePhase) -> None:
    until = time.monotonic() + 60.0
    while (status := status_of(services)).phase != phase:
        assert time.monotonic() < until, status
        time.sleep(0.02)


@pytest.mark.timeout(300)
def test_a_test_that_was_resumed_gives_the_same_bytes(tmp_path):
    results = []
    for kills in (0, 2):
        settings = {"sequencer": {"repeats_per_recording": 20}, "rig_sim": {"crack_repeat": 45, "crack": 0.02}}
        with KillableServices(tmp_path / str(kills), settings=settings) as services:
            bus = services.bus
            extra = "actions: {warning: log, abort: log}"
            spec = specification(services, "same", repeats=70, extra=extra)
            bus.query(bus.keys.endurance_start(RIG), spec, sequencer_pb2.EnduranceStatus)
            for _ in range(kills):
                request = sequencer_pb2.HoldEnduranceRequest(reason="to be killed")
                bus.query(bus.keys.endurance_hold("same"), request, sequencer_pb2.EnduranceStatus)
                wait_for(services, sequencer_pb2.ENDURANCE_PHASE_HOLDING)
                services.kill("sequencer")
                services.start("sequencer")
                services.wait_until_whole()
                resume = sequencer_pb2.ResumeEnduranceRequest()
                bus.query(bus.keys.endurance_resume("same", RIG), resume, sequencer_pb2.EnduranceStatus)
                time.sleep(0.3)
            wait_for(services, sequencer_pb2.ENDURANCE_PHASE_FINISHED)
            results.append(figures(services))
    assert results[0] == results[1]
    assert len(results[0]) == 70 + 4
    assert any(figure[-1] for figure in results[0] if len(figure) == 5), "the crack was to be found"


@pytest.mark.timeout(300)
def test_samples_that_a_killed_sequencer_held_are_kept_if_an_alarm_follows(tmp_path):
    settings = {
        "sequencer": {"held_folder": str(tmp_path / "held")},
        "rig_sim": {"crack_repeat": 40, "crack": 0.5, "run_seconds": 0.1},
    }
    with KillableServices(tmp_path, settings=settings) as services:
        bus = services.bus
        extra = "keep: {first: 0, every: null, around_alarm: 30}\nactions: {warning: log, abort: log}"
        spec = specification(services, "same", repeats=60, extra=extra)
        bus.query(bus.keys.endurance_start(RIG), spec, sequencer_pb2.EnduranceStatus)
        while status_of(services).played < 15:
            time.sleep(0.02)
        request = sequencer_pb2.HoldEnduranceRequest(reason="to be killed")
        bus.query(bus.keys.endurance_hold("same"), request, sequencer_pb2.EnduranceStatus)
        wait_for(services, sequencer_pb2.ENDURANCE_PHASE_HOLDING)
        played = status_of(services).played
        services.kill("sequencer")
        assert len(list((tmp_path / "held" / "same").glob("*.npz"))) == played
        services.start("sequencer")
        services.wait_until_whole()
        resume = sequencer_pb2.ResumeEnduranceRequest()
        bus.query(bus.keys.endurance_resume("same", RIG), resume, sequencer_pb2.EnduranceStatus)
        wait_for(services, sequencer_pb2.ENDURANCE_PHASE_FINISHED)
        steps = list(recorded_steps(services, "same"))
        alarm = next(step.repeat for step in steps if isinstance(step, sequencer_pb2.EnduranceRepeat) and step.alarms)
        kept = [step.repeat for step in steps if isinstance(step, sequencer_pb2.RepeatSamples)]
        assert alarm - 30 < played < alarm
        assert kept[:31] == list(range(alarm - 30, alarm + 1))
        assert not (tmp_path / "held" / "same").exists()
