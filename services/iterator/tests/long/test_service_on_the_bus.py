import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml

from duralab_bus import BusConfig, Continuity, FaultError, open_bus
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.campaign import seeds

from ..fake_lab import FINAL, Identifier, Lab, Recorder
from ..linear_rig import specification
from ..rig_process import known_rig

LAB = "iterator_test"
RIGS = {"front": 0.0, "worn": 0.0, "slow": 2.5, "endless": 5.0}
#: Of the rigs, in N: the seed of a playback is seen in it, and nothing else is.
NOISE = 1e-3
#: Specification, description, target, then run, model and its end.
STEPS_BEFORE_PLAYBACKS = 6
RIG_PROCESS = Path(__file__).parents[1] / "rig_process.py"


@contextmanager
def process(bus, folder, *command, lab=LAB, **config):
    file = folder / f"{Path(command[-1]).stem}.yaml"
    settings = {"bus": {"lab": lab, "connect": list(bus.listening)}, "exit_with_parent": True, **config}
    file.write_text(yaml.safe_dump(settings))
    with subprocess.Popen([sys.executable, *command, "--config", str(file)], stdin=subprocess.PIPE) as running:
        try:
            yield running
        finally:
            running.terminate()
            try:
                running.wait(5.0)
            except subprocess.TimeoutExpired:
                running.kill()


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with open_bus(BusConfig(lab=LAB), service="test") as hub:
        joined = BusConfig(lab=LAB, connect=hub.listening)
        with (
            open_bus(joined, service="recorder") as recorder,
            open_bus(joined, service="identifier") as identifier,
            process(hub, folder, "-m", "iterator"),
            process(hub, folder, str(RIG_PROCESS), rigs=RIGS, noise_rms=NOISE, cannot_be_stopped=["endless"]),
        ):
            lab = Lab(hub, Recorder(recorder), Identifier(identifier))
            wanted = {("iterator", "main"), *(("rig_sim", rig) for rig in RIGS)}
            hub.wait_for_live(wanted | {("recorder", "main"), ("identifier", "main")}, 120.0)
            yield lab


@contextmanager
def events_of(lab, id):
    received, ended = [], threading.Event()

    def on_event(item):
        received.append((time.monotonic(), item))
        if item.message.status.phase in FINAL:
            ended.set()

    subscription = lab.bus.subscribe(lab.bus.keys.campaign_event(id), iterator_pb2.CampaignEvent, on_event, repair=True)
    try:
        yield received, ended
    finally:
        subscription.close()


def test_an_overdue_calibration_and_a_crossed_warning_level_are_remarks(lab):
    accepted = lab.start(specification("worn", rig="worn", iterations=2))
    overdue = "The calibration of left_vertical (LC-1) is overdue since 2020-02-29"
    assert accepted.remarks[0].startswith(overdue)
    final = lab.end_of("worn")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    for step in lab.recorder.read("worn", iterator_pb2.IterationStep):
        (warning,) = (remark for remark in step.remarks if "warning level" in remark)
        assert warning.startswith(f"Playback {step.iteration}: The response of left_vertical was ")
        assert warning.endswith("its warning level allows -4500 to 4500 N.")
        assert warning in final.remarks
    assert sum("warning level" in remark for remark in final.remarks) == 2
    assert lab.recorder.read("worn", rig_pb2.RigDescription)[0].responses[0].sensor.serial_number == "LC-1"


def test_a_campaign_stores_every_step_and_converges(lab):
    with events_of(lab, "whole") as (events, ended):
        accepted = lab.start(specification("whole", iterations=4))
        assert accepted.phase == iterator_pb2.CAMPAIGN_PHASE_CHECKING
        assert ended.wait(20.0)
    final = lab.status("whole")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert final.outcome == iterator_pb2.OUTCOME_ITERATIONS_USED
    assert final.best_iteration == 4
    assert final.fraction == 1.0
    for iteration in final.iterations:
        for channel in iteration.channels:
            assert channel.relative_rms_error == pytest.approx(0.5**iteration.iteration, rel=0.01)

    playback = ["RunPlanned", "IterationStep", "RunPlayed"]
    assert lab.recorder.kinds("whole") == [
        *("CampaignSpec", "RigDescription", "TargetInBand", "RunPlanned", "Model", "RunPlayed"),
        *(4 * playback),
        *("CampaignStatus", "RecordingClosed"),
    ]
    planned = lab.recorder.read("whole", recorder_pb2.RunPlanned)
    assert [run.run for run in planned] == ["whole.identify", "whole.i01", "whole.i02", "whole.i03", "whole.i04"]
    played = lab.recorder.read("whole", recorder_pb2.RunPlayed)
    assert [run.epoch > 7 for run in played] == [False, True, True, True, True]
    for step in lab.recorder.read("whole", iterator_pb2.IterationStep):
        # What the rig measures with the seed of this playback, and with no other.
        drive, seed = from_array(step.drive.samples), seeds.derived_seed(11, seeds.playback(step.iteration))
        expected = known_rig(noise_rms=NOISE).respond(drive, seed=seed)
        np.testing.assert_allclose(from_array(step.response.samples), expected, rtol=0.0, atol=1e-3 * NOISE)
    assert [run.blocks for run in played] == [3, 80, 80, 80, 80]
    request = lab.identifier.requests["whole.identify"]
    assert request.excitation.seed == seeds.derived_seed(11, seeds.EXCITATION)
    assert request.rig_seed == seeds.derived_seed(11, seeds.IDENTIFICATION_PLAYBACK)
    step = lab.recorder.read("whole", iterator_pb2.IterationStep)[-1]
    assert list(step.inverse_frf.shape) == [257, 2, 2]
    assert list(step.error_in_band.shape) == list(step.drive.samples.shape) == [2, 8000]
    peak = np.abs(from_array(step.drive.samples)).max(axis=1) / 0.5
    assert [use.peak_command_ratio for use in step.actuators] == pytest.approx(list(peak))
    stored = lab.recorder.read("whole", iterator_pb2.CampaignStatus)[0]
    assert stored == final

    statuses = [item.message.status for _, item in events]
    continuity = Continuity()
    assert [continuity.accept(item.seq) for _, item in events] == [[] for _ in events]
    assert [status.phase for status in statuses] == sorted(status.phase for status in statuses)
    assert np.all(np.diff([status.fraction for status in statuses]) >= 0.0)
    activities = {status.activity for status in statuses}
    assert {f"playing iteration {k} of 4 on front" for k in (1, 2, 3, 4)} <= activities
    assert "identifying front" in activities
    assert [len(status.iterations) for status in statuses][-1] == 4


def test_a_stopped_campaign_leaves_the_rig_at_rest_and_the_recording_closed(lab):
    with events_of(lab, "halted") as (events, ended):
        lab.start(specification("halted", rig="slow"))
        # The identification is the first quarter: the first playback has begun to count.
        lab.wait("halted", lambda status: status.fraction > 0.25)
        with pytest.raises(FaultError, match="in use by campaign 'halted'") as caught:
            lab.start(specification("second", rig="slow"))
        assert caught.value.code == query_pb2.FAULT_CODE_BUSY
        status = lab.stop("halted", reason="the shaft is loose")
        assert ended.wait(5.0)
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    assert "playing iteration 1 of 3 on slow" in status.fault.message
    assert "the shaft is loose" in status.fault.message
    state = lab.rig_state("slow")
    assert (state.mode, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "")
    assert "the shaft is loose" in state.reason
    assert lab.recorder.kinds("halted")[-2:] == ["CampaignStatus", "RecordingClosed"]
    assert "the shaft is loose" in lab.recorder.read("halted", recorder_pb2.RecordingClosed)[0].reason
    playing = [at for at, item in events if item.message.status.activity.startswith("playing")]
    assert np.max(np.diff(playing)) < 1.0
    fractions = [item.message.status.fraction for _, item in events]
    assert 0.25 < max(fractions) < 0.6
    # Stopping again changes nothing.
    assert lab.stop("halted", reason="again") == status
    lab.reset("slow")


@pytest.mark.parametrize(("iterations", "step", "phase"), [(3, 7, "STOPPED"), (1, 9, "FINISHED")])
def test_a_stop_latches_the_rig_also_where_its_playback_has_just_ended(lab, iterations, step, phase):
    """Between two playbacks, and while the recording of a campaign is closed that has made all of them."""
    id, storing, stopped = f"just-ended-{step}", threading.Event(), threading.Event()

    def hold(*stored):
        if stored == (id, step, False):
            storing.set()
            assert stopped.wait(20.0)

    lab.recorder.watch = hold
    lab.start(specification(id, iterations=iterations))
    assert storing.wait(20.0)
    assert lab.rig_state("front").mode == rig_pb2.RIG_MODE_IDLE
    status = lab.stop(id, reason="the shaft is loose", on_progress=lambda told: told.phase and stopped.set())
    lab.recorder.watch = lambda *_: None
    assert status.phase == getattr(iterator_pb2, f"CAMPAIGN_PHASE_{phase}")
    state = lab.rig_state("front")
    assert (state.mode, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "")
    assert "the shaft is loose" in state.reason
    assert lab.reset("front").mode == rig_pb2.RIG_MODE_IDLE


def test_a_stop_says_that_a_run_goes_on_where_it_cannot_be_stopped(lab):
    lab.start(specification("onward", rig="endless"))
    lab.wait("onward", lambda status: "waiting for the operator" in status.activity)
    status, state = lab.stop("onward", reason="the shaft is loose"), lab.rig_state("endless")
    said = "he run 'onward.i01' cannot be stopped and goes on to its end, and endless is latched from then on"
    assert status.activity == f"stopped while playing iteration 1 of 3 on endless; t{said}"
    assert status.fault.message.endswith(f": the shaft is loose. T{said}.")
    assert lab.recorder.read("onward", recorder_pb2.RecordingClosed)[0].reason == status.fault.message
    assert (state.mode, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "onward.i01")
    # A reset waits for the end of the run.
    assert lab.reset("endless").mode == rig_pb2.RIG_MODE_IDLE


def test_the_words_of_a_rig_are_the_activity_of_its_campaign(lab):
    with events_of(lab, "words") as (events, ended):
        lab.start(specification("words", rig="slow", iterations=1))
        assert ended.wait(20.0)
    activities = {item.message.status.activity for _, item in events}
    playing = "playing iteration 1 of 1 on slow"
    # On one line, without what would move a terminal's cursor; that it plays is not said twice.
    assert {a for a in activities if a.startswith(playing)} == {
        playing,
        f"{playing}: waiting for the operator [2J to press start",
    }


def test_a_rig_killed_in_mid_playback_ends_the_campaign_with_a_clear_sentence(lab, tmp_path):
    with process(lab.bus, tmp_path, str(RIG_PROCESS), rigs={"mortal": 30.0}) as rig:
        lab.bus.wait_for_live({("rig_sim", "mortal")}, 120.0)
        lab.start(specification("orphan", rig="mortal"))
        lab.wait("orphan", lambda status: status.activity.startswith("playing iteration 1"))
        time.sleep(0.3)
        killed = time.monotonic()
        rig.kill()
        status = lab.end_of("orphan", seconds=5.0)
        assert time.monotonic() - killed < 3.0
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert status.fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert status.fault.message.startswith(
        "The campaign failed while playing iteration 1 of 3 on mortal: The rig 'mortal' left the bus"
    )
    assert lab.recorder.kinds("orphan")[-2:] == ["CampaignStatus", "RecordingClosed"]
    assert lab.recorder.kinds("orphan").count("RunPlanned") == 2


def test_an_identifier_that_refuses_ends_the_campaign(lab):
    lab.identifier.refused.add("dependent.identify")
    lab.start(specification("dependent"))
    status = lab.end_of("dependent")
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert status.fault.service == "identifier"
    assert status.fault.message == "The campaign failed while identifying front: The drives are dependent."
    assert lab.recorder.kinds("dependent")[-1] == "RecordingClosed"


def test_a_recorder_that_refuses_ends_the_campaign_before_the_next_playback(lab):
    lab.recorder.refused["full"] = "IterationStep"
    lab.start(specification("full"))
    status = lab.end_of("full")
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert status.fault.service == "recorder"
    assert "storing iteration 1 of 3: The disk is full." in status.fault.message
    assert lab.recorder.kinds("full").count("RunPlanned") == 2
    # The rig is free again.
    lab.start(specification("after-full", iterations=1))
    assert lab.end_of("after-full").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED


@contextmanager
def first_playback_being_stored(lab, id):
    """A campaign whose recorder takes its time with the first playback; yields the event that lets it store it."""
    arrived, may_store = threading.Event(), threading.Event()

    def watch(recording, step, stored):
        if recording == id and step == STEPS_BEFORE_PLAYBACKS + 1 and not stored:
            arrived.set()
            assert may_store.wait(20.0)

    lab.recorder.watch = watch
    try:
        lab.start(specification(id))
        assert arrived.wait(20.0)
        yield may_store
    finally:
        may_store.set()
        lab.recorder.watch = lambda *_: None


def wait_for_activity(lab, id, activity):
    until = time.monotonic() + 10.0
    while lab.status(id).activity != activity:
        assert time.monotonic() < until, lab.status(id).activity
        time.sleep(0.01)


def test_the_next_drive_is_computed_while_a_playback_is_stored_and_not_played_before(lab):
    with first_playback_being_stored(lab, "beside") as may_store:
        wait_for_activity(lab, "beside", "computing the drive of iteration 2 of 3")
        # Before it is stored, its figures are not shown and the next motion is not announced.
        assert len(lab.status("beside").iterations) == 0
        assert lab.recorder.kinds("beside").count("RunPlanned") == 2
        assert lab.rig_state("front").mode == rig_pb2.RIG_MODE_IDLE
        may_store.set()
        final = lab.end_of("beside")
    assert [iteration.iteration for iteration in final.iterations] == [1, 2, 3]
    assert lab.recorder.kinds("beside")[STEPS_BEFORE_PLAYBACKS:-2] == 3 * ["RunPlanned", "IterationStep", "RunPlayed"]


def test_a_stop_while_a_playback_is_stored_stores_it_and_closes_the_recording(lab):
    with first_playback_being_stored(lab, "cut-short") as may_store:
        wait_for_activity(lab, "cut-short", "computing the drive of iteration 2 of 3")
        lab.stop("cut-short")
        may_store.set()
        final = lab.end_of("cut-short")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    assert [iteration.iteration for iteration in final.iterations] == [1]
    ended = ["RunPlanned", "IterationStep", "RunPlayed", "CampaignStatus", "RecordingClosed"]
    assert lab.recorder.kinds("cut-short")[STEPS_BEFORE_PLAYBACKS:] == ended
    lab.reset("front")


def test_a_drive_beyond_the_limits_is_not_played_and_the_fault_says_what_would_fit(lab):
    lab.start(specification("large", level=(9e4, 40.0)))
    status = lab.end_of("large")
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert status.fault.field == "update.iteration_gain"
    assert "The next drive of left would reach a slew of" in status.fault.message
    assert "past the rig's limit of 100 m/s; it would fit with" in status.fault.message
    assert lab.recorder.kinds("large").count("RunPlanned") == 1


@pytest.fixture(scope="module")
def ended(lab):
    """A campaign of this process that has ended, whatever other tests ran before."""
    lab.start(specification("ended", iterations=1))
    lab.end_of("ended")


def nan_target(spec):
    spec.target.samples.data = b"\xff" * len(spec.target.samples.data)


INVALID, NOT_FOUND, EXISTS = (
    query_pb2.FAULT_CODE_INVALID_ARGUMENT,
    query_pb2.FAULT_CODE_NOT_FOUND,
    query_pb2.FAULT_CODE_ALREADY_EXISTS,
)


@pytest.mark.parametrize(
    ("change", "code", "field", "sentence"),
    [
        (lambda s: setattr(s, "rig", "rear"), NOT_FOUND, "rig", "No rig 'rear' is on the bus"),
        (lambda s: setattr(s, "id", "../up"), INVALID, "id", "'../up'"),
        (lambda s: setattr(s, "id", "a" * 105), INVALID, "id", "has 105 characters; a campaign's has at most 104"),
        (lambda s: setattr(s, "id", "ended"), EXISTS, "id", "'ended' exists already"),
        (lambda s: setattr(s, "id", "old"), EXISTS, "id", "'old' exists already"),
        (nan_target, INVALID, "target.samples", "nan"),
        (lambda s: setattr(s, "highest_frequency", 200.0), INVALID, "highest_frequency", "100"),
    ],
)
def test_a_start_that_cannot_be_is_refused_at_once_and_leaves_nothing(lab, ended, change, code, field, sentence):
    spec = specification("refused")
    change(spec)
    stored = {recording: len(steps) for recording, steps in lab.recorder.steps.items()}
    with pytest.raises(FaultError) as caught:
        lab.start(spec)
    assert (caught.value.code, caught.value.field) == (code, field)
    assert sentence in caught.value.message
    assert {recording: len(steps) for recording, steps in lab.recorder.steps.items()} == stored
    with pytest.raises(FaultError, match="No campaign 'refused'"):
        lab.status("refused")


@pytest.mark.parametrize(("rig", "sentence"), [("Rear!", "'Rear!' is not a name"), ("rear", "is that of rig 'beam'")])
def test_a_campaign_on_another_rig_than_its_key_names_is_refused(lab, rig, sentence):
    spec = specification("elsewhere")
    spec.rig = rig
    with pytest.raises(FaultError, match=sentence) as caught:
        lab.start(spec, rig="beam")
    assert (caught.value.code, caught.value.field) == (INVALID, "rig")
    assert "elsewhere" not in lab.recorder.steps


def test_an_experiment_that_cannot_be_played_is_refused_before_anything_is_stored(lab):
    lab.identifier.unplayable.add("unplayable.identify")
    with pytest.raises(FaultError) as caught:
        lab.start(specification("unplayable"))
    assert (caught.value.code, caught.value.field) == (INVALID, "excitation.rms")
    assert "unplayable" not in lab.recorder.steps
    lab.identifier.unplayable.clear()
    lab.start(specification("unplayable"))
    assert lab.end_of("unplayable").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
