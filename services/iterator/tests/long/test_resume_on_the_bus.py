"""A campaign whose iterator is killed goes on as if nothing had happened; an ended one is taken up by a new one."""

import threading
from contextlib import suppress

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2

from ..killable_lab import killable_lab, killed_at, playbacks, resumed
from ..linear_rig import specification

ITERATIONS = 3
# Specification, rig, target, and for each of identification and playbacks: planned, result, played; status, end.
STEPS = 3 + 3 * (1 + ITERATIONS) + 2


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with killable_lab("iterator_resume_test", tmp_path_factory.mktemp("lab"), {"front": 0.1, "rear": 0.1}) as lab:
        yield lab


@pytest.fixture(scope="module")
def undisturbed(lab):
    lab.start(specification("undisturbed", iterations=ITERATIONS))
    assert lab.end_of("undisturbed").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    return playbacks(lab, "undisturbed")


def random_moments(count=10):
    """Steps of all kinds, before they are stored, after, and up to a playback's length later."""
    generator = np.random.default_rng(20261121)
    # Not the very last step: then the campaign is over.
    steps = generator.choice(np.arange(STEPS - 1), size=count, replace=False)
    return [(int(step), bool(generator.integers(2)), float(generator.choice([0.0, 0.03, 0.12]))) for step in steps]


def test_a_campaign_killed_at_ten_random_moments_ends_with_the_same_bytes(lab, undisturbed):
    for attempt, (step, stored, later) in enumerate(random_moments()):
        id = f"killed-{attempt}"
        with killed_at(lab, id, step, stored=stored, later=later) as killed:
            # A kill at the first step may come before the answer.
            with suppress(FaultError):
                lab.start(specification(id, iterations=ITERATIONS))
            assert killed.wait(20.0)
        lab.iterator.end()
        lab.iterator.start()
        lab.iterator.wait()
        committed = lab.recorder.kinds(id) if id in lab.recorder.steps else []
        if not committed:
            lab.start(specification(id, iterations=ITERATIONS))
        elif committed[-1] != "RecordingClosed":
            resumed(lab, id)
        if not committed or committed[-1] != "RecordingClosed":
            assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED, (step, stored, later)
        assert playbacks(lab, id) == undisturbed, (step, stored, later)
        # What was committed stays as it was, and no motion that was committed is asked for again.
        assert lab.recorder.kinds(id)[: len(committed)] == committed
        runs = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlanned)]
        done = [step.run for step in lab.recorder.read(id, iterator_pb2.IterationStep)]
        played = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlayed)]
        assert len(set(runs)) == len(runs) <= 2 + ITERATIONS
        assert sorted(played[1:]) == sorted(done)
        assert lab.recorder.kinds(id)[-2:] == ["CampaignStatus", "RecordingClosed"]


@pytest.mark.parametrize(("step", "stored"), [(15, True), (16, False), (19, True)])
def test_a_campaign_killed_while_its_result_is_confirmed_goes_on_there(lab, undisturbed, step, stored):
    id = f"confirming-{step}"
    spec = specification(id, iterations=ITERATIONS)
    spec.confirmations = 2
    # Announced, played and not yet stored, and the second one stored without its end.
    with killed_at(lab, id, step, stored=stored, later=0.0) as killed:
        lab.start(spec)
        assert killed.wait(20.0)
    lab.iterator.end()
    lab.iterator.start()
    lab.iterator.wait()
    resumed(lab, id)
    final = lab.end_of(id)
    assert (final.phase, final.repeatability.playbacks) == (iterator_pb2.CAMPAIGN_PHASE_FINISHED, 3)
    assert playbacks(lab, id) == undisturbed
    confirmations = lab.recorder.read(id, iterator_pb2.ConfirmationStep)
    assert [confirmation.number for confirmation in confirmations] == [1, 2]
    # A linear rig without noise answers the same drive with the same bytes.
    assert {confirmation.response.samples.data for confirmation in confirmations} == {undisturbed[-1][2]}
    played = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlayed)]
    assert played[-2:] == [confirmation.run for confirmation in confirmations]
    planned = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlanned)]
    assert len(set(planned)) == len(planned) == 1 + ITERATIONS + 2 + (step < 19)


@pytest.mark.parametrize(("before_the_end", "stored"), [(2, False), (2, True), (1, False), (1, True)])
def test_a_campaign_whose_end_the_recorder_did_not_acknowledge_ends_without_another_motion(
    lab, undisturbed, before_the_end, stored
):
    id, lost = f"unacknowledged-{before_the_end}-{int(stored)}", STEPS - before_the_end

    def watch(name, number, is_stored):
        if (name, number, is_stored) == (id, lost, stored):
            raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, "The recorder was killed.")

    lab.recorder.watch = watch
    lab.start(specification(id, iterations=ITERATIONS))
    shown = lab.end_of(id)
    lab.recorder.watch = lambda *_: None
    assert shown.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert "while closing the recording" in shown.fault.message
    assert "resume it, and it ends without a motion" in shown.fault.message
    lab.resume(id)
    assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert playbacks(lab, id) == undisturbed
    # One end, and no run besides the identification and the playbacks.
    assert lab.recorder.kinds(id).count("CampaignStatus") == 1
    assert lab.recorder.kinds(id)[-2:] == ["CampaignStatus", "RecordingClosed"]
    assert len(lab.recorder.read(id, recorder_pb2.RunPlanned)) == 1 + ITERATIONS


def test_a_stopped_campaign_is_taken_up_by_a_new_one_that_names_it(lab, undisturbed):
    seen = threading.Event()
    lab.recorder.watch = lambda name, step, stored: seen.set() if (name, step, stored) == ("halted", 9, False) else None
    lab.start(specification("halted", iterations=ITERATIONS))
    assert seen.wait(20.0)
    assert lab.stop("halted").phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    lab.recorder.watch = lambda *_: None
    with pytest.raises(FaultError, match=r"has ended .* name a new_id") as caught:
        lab.resume("halted")
    assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "new_id")
    there = len(playbacks(lab, "halted"))
    assert 1 <= there < ITERATIONS
    # The stop has latched its rig, wherever in its playbacks it was.
    with pytest.raises(FaultError, match=r"Rig 'front' is interlocked \(The campaign was stopped .* reset it first"):
        lab.resume("halted", new_id="halted-2")
    lab.reset("front")
    lab.resume("halted", new_id="halted-2")
    final = lab.end_of("halted-2")
    assert (final.phase, final.outcome) == (iterator_pb2.CAMPAIGN_PHASE_FINISHED, iterator_pb2.OUTCOME_ITERATIONS_USED)
    assert [metrics.iteration for metrics in final.iterations] == [1, 2, 3]
    assert playbacks(lab, "halted-2") == undisturbed
    (spec,) = lab.recorder.read("halted-2", iterator_pb2.CampaignSpec)
    assert (spec.parent, spec.parent_iteration) == ("halted", there)
    assert [run.run for run in lab.recorder.read("halted-2", recorder_pb2.RunPlanned)] == [
        f"halted-2.i{number:02d}" for number in range(there + 1, ITERATIONS + 1)
    ]


def test_a_campaign_is_taken_up_from_an_earlier_playback_with_other_settings(lab, undisturbed):
    spec = specification("other")
    update, stop = spec.update, spec.stop
    update.kind = iterator_pb2.UPDATE_KIND_BASIC_TWR
    update.iteration_gain.CopyFrom(to_array(np.array([0.8, 0.8])))
    stop.iterations = 4
    lab.resume("undisturbed", new_id="other", from_iteration=1, update=update, stop=stop)
    assert lab.end_of("other").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    steps = lab.recorder.read("other", iterator_pb2.IterationStep)
    assert playbacks(lab, "other")[0] == undisturbed[0]
    errors = [step.metrics.overall_relative_rms_error for step in steps]
    # An exact model: what the first playback at gain 0.5 left shrinks by 1 - 0.8 each time.
    assert errors == pytest.approx([0.5 * 0.2**k for k in range(4)], rel=0.02)


@pytest.mark.parametrize("new_ids", [("", ""), ("one", "one"), ("first", "second")])
def test_of_two_resumes_at_once_exactly_one_goes_on(lab, undisturbed, new_ids):
    """The first request is held up with what it read until the second is answered, and what it began has ended."""
    id = f"twice-{new_ids[0]}"
    with killed_at(lab, id, 9, stored=True, later=0.0) as killed:
        lab.start(specification(id, iterations=ITERATIONS))
        assert killed.wait(20.0)
    lab.iterator.end()
    lab.iterator.start()
    lab.iterator.wait()
    reading, may_go_on = threading.Event(), threading.Event()

    def hold_up(name, last):
        if name == id and last and not reading.is_set():
            reading.set()
            assert may_go_on.wait(20.0)

    def attempt(new_id):
        try:
            lab.resume(id, new_id=new_id)
        except FaultError as fault:
            refused.append(fault)
        else:
            accepted.append(new_id or id)

    accepted, refused = [], []
    lab.recorder.watch_reading = hold_up
    first = threading.Thread(target=attempt, args=new_ids[:1])
    first.start()
    assert reading.wait(20.0)
    attempt(new_ids[1])
    for campaign in accepted:
        lab.end_of(campaign)
    may_go_on.set()
    first.join(20.0)
    lab.recorder.watch_reading = lambda *_: None
    assert (len(accepted), len(refused)) == (1, 1)
    assert refused[0].code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
    assert "is being resumed by another request" in refused[0].message
    assert lab.end_of(accepted[0]).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert playbacks(lab, accepted[0]) == undisturbed
    runs = [run.run for run in lab.recorder.read(accepted[0], recorder_pb2.RunPlayed)]
    assert len(set(runs)) == len(runs)


def at_target(id):
    spec = specification(id, iterations=1)
    spec.at_target.level, spec.at_target.duration = 0.4, 30.0
    spec.excitation.kind = identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL
    return spec


# After target: first run planned, its model, its end; second run planned, its model, its end.
@pytest.mark.parametrize("step", range(3, 9))
def test_a_campaign_killed_between_the_experiments_of_its_identification_repeats_none_that_was_stored(lab, step):
    id = f"two-{step}"
    with killed_at(lab, id, step, stored=True, later=0.0) as killed:
        lab.start(at_target(id))
        assert killed.wait(20.0)
    lab.iterator.end()
    lab.iterator.start()
    lab.iterator.wait()
    resumed(lab, id)
    assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    models = lab.recorder.read(id, identifier_pb2.Model)
    assert [model.run.removesuffix("-2") for model in models] == [f"{id}.identify", f"{id}.at_target"]
    assert (models[1].shaped_by, models[1].target_level) == (models[0].run, 0.4)
    request = lab.identifier.requests[models[1].run]
    assert [channel.name for channel in request.shape.target.channels] == [c.name for c in models[0].responses]
    assert (request.shape.lowest_frequency, request.shape.highest_frequency, request.shape.level) == (2.0, 60.0, 0.4)
    assert (request.excitation.duration, request.excitation.static_hold) == (30.0, 0.0)
    first = lab.identifier.requests[models[0].run]
    assert request.excitation.seed != first.excitation.seed
    assert request.rig_seed != first.rig_seed
    planned = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlanned)]
    # Only what was announced and not stored is asked for again.
    again = {3: [f"{id}.identify-2"], 6: [f"{id}.at_target-2"]}.get(step, [])
    assert [run for run in planned if run.endswith("-2")] == again


@pytest.mark.parametrize(
    ("id", "settings", "code", "field"),
    [
        ("nobody", {}, query_pb2.FAULT_CODE_NOT_FOUND, None),
        ("undisturbed", {"new_id": "x", "rig": "beam"}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "rig"),
        ("undisturbed", {"from_iteration": 1}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "new_id"),
        ("undisturbed", {"new_id": "../up"}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "new_id"),
        ("undisturbed", {"new_id": "a" * 105}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "new_id"),
        ("undisturbed", {"new_id": "old"}, query_pb2.FAULT_CODE_ALREADY_EXISTS, "new_id"),
        ("undisturbed", {"new_id": "x", "from_iteration": 9}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "from_iteration"),
        ("undisturbed", {"new_id": "x"}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "stop.iterations"),
    ],
)
def test_what_cannot_be_resumed_is_refused_with_its_field(lab, undisturbed, id, settings, code, field):
    with pytest.raises(FaultError) as caught:
        lab.resume(id, **settings)
    assert caught.value.code == code
    assert field is None or caught.value.field == field
    assert "x" not in lab.recorder.steps


def test_a_start_does_not_invent_a_parent(lab):
    spec = specification("orphaned")
    spec.parent = "undisturbed"
    with pytest.raises(FaultError, match="ask it to resume") as caught:
        lab.start(spec)
    assert caught.value.field == "parent"


def test_two_rigs_run_campaigns_at_once(lab, undisturbed):
    both = threading.Barrier(2, timeout=20.0)

    def watch(name, step, stored):
        # Each waits at its first playback until the other is there: neither could finish alone.
        if step == 6 and not stored and name in ("twin-front", "twin-rear"):
            both.wait()

    lab.recorder.watch = watch
    lab.start(specification("twin-front", rig="front", iterations=ITERATIONS))
    lab.start(specification("twin-rear", rig="rear", iterations=ITERATIONS))
    for id in ("twin-front", "twin-rear"):
        assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
        assert playbacks(lab, id) == undisturbed
    lab.recorder.watch = lambda *_: None


def test_partial_levels_play_a_share_of_the_drive_first(lab, undisturbed):
    spec = specification("levels", iterations=4)
    spec.levels.extend([0.5, 0.75, 1.0])
    lab.start(spec)
    final = lab.end_of("levels")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    steps = lab.recorder.read("levels", iterator_pb2.IterationStep)
    assert [step.level for step in steps] == [step.metrics.level for step in steps] == [0.5, 0.75, 1.0, 1.0]
    first = from_array(lab.recorder.read("undisturbed", iterator_pb2.IterationStep)[0].drive.samples)
    np.testing.assert_allclose(from_array(steps[0].drive.samples), 0.5 * first, rtol=1e-12, atol=0.0)
    # A linear rig does not know of the level.
    errors = [step.metrics.overall_relative_rms_error for step in steps]
    assert errors == pytest.approx([0.5**k for k in (1, 2, 3, 4)], rel=0.01)
    assert final.best_iteration == 4
