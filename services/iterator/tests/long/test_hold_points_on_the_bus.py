"""A campaign waits at its hold points, does what is decided there, and survives a kill in the middle of it."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.campaign import plan_campaign

from ..killable_lab import killable_lab, killed_at, playbacks, resumed
from ..linear_rig import description, experiment_plan, specification

EACH = iterator_pb2.HoldSettings(when=iterator_pb2.HOLD_POINT_EACH)
FIRST = iterator_pb2.HoldSettings(when=iterator_pb2.HOLD_POINT_FIRST)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with killable_lab("iterator_hold_test", tmp_path_factory.mktemp("lab"), {"front": 0.0, "rear": 0.1}) as lab:
        yield lab


def held_campaign(id, hold=EACH, **settings):
    spec = specification(id, **settings)
    spec.hold.CopyFrom(hold)
    return spec


def with_gain(gain, kind=iterator_pb2.UPDATE_KIND_BASIC_TWR):
    update = iterator_pb2.UpdateSettings(kind=kind)
    update.CopyFrom(specification().update)
    update.kind = kind
    update.iteration_gain.CopyFrom(to_array(np.array([gain, gain])))
    return update


# Before which proposal, what is decided: gains changed at playback 3, back to 2 at 5.
SCRIPT = [
    (1, "PLAY", {}),
    (2, "PLAY", {}),
    (3, "CHANGE", {"update": with_gain(0.8), "scenario": "name: bolder\n"}),
    (4, "PLAY", {}),
    (5, "PLAY", {}),
    (6, "BACK", {"from_iteration": 2}),
    (7, "PLAY", {}),
]


def driven(lab, id, script=SCRIPT):
    for proposal, kind, settings in script:
        lab.held(id, proposal)
        lab.decide(id, proposal, kind, **settings)


@pytest.fixture(scope="module")
def undisturbed(lab):
    lab.start(held_campaign("undisturbed", iterations=5))
    driven(lab, "undisturbed")
    assert lab.end_of("undisturbed").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    return playbacks(lab, "undisturbed")


def errors_of(lab, id):
    return [step.metrics.overall_relative_rms_error for step in lab.recorder.read(id, iterator_pb2.IterationStep)]


def test_gains_changed_at_one_playback_and_a_way_back_at_another_give_the_drives_that_they_should(lab, undisturbed):
    # An exact model: each playback leaves 1 - gain of the error that the playback it follows left.
    half, bold = 0.5, 0.2
    expected = [half, half**2, half**2 * bold, half**2 * bold**2, half**2 * bold]
    assert errors_of(lab, "undisturbed") == pytest.approx(expected, rel=0.02)
    # Made from the same playback by the same settings.
    assert undisturbed[4][1] == undisturbed[2][1]


def test_the_recording_says_who_decided_what_before_it_was_played(lab, undisturbed):
    kinds = lab.recorder.kinds("undisturbed")
    playback = ["RunPlanned", "IterationStep", "RunPlayed"]
    asked = ["Proposal", "Decision"]
    released, revised = [*asked, *playback], [*asked, *asked, *playback]
    assert kinds[6:-2] == [*released, *released, *revised, *released, *revised]
    decisions = lab.recorder.read("undisturbed", iterator_pb2.Decision)
    proposals = lab.recorder.read("undisturbed", iterator_pb2.Proposal)
    assert [decision.proposal for decision in decisions] == [proposal.number for proposal in proposals]
    assert [decision.playback for decision in decisions] == [1, 2, 3, 3, 4, 5, 5]
    assert {(decision.name, decision.reason) for decision in decisions} == {("Ada", "as foreseen")}
    assert all(decision.decided > 1.7e18 for decision in decisions)
    assert [proposal.follows for proposal in proposals] == [0, 1, 2, 2, 3, 4, 2]
    assert [proposal.scenario for proposal in proposals] == 3 * ["name: try\n"] + 4 * ["name: bolder\n"]


def test_a_proposal_has_the_drive_that_is_played_and_predicts_its_response(lab, undisturbed):
    proposals = lab.recorder.read("undisturbed", iterator_pb2.Proposal)
    steps = {step.iteration: step for step in lab.recorder.read("undisturbed", iterator_pb2.IterationStep)}
    (target,) = lab.recorder.read("undisturbed", iterator_pb2.TargetInBand)
    for proposal in (proposals[0], proposals[3], proposals[6]):
        step = steps[proposal.playback]
        drive = from_array(proposal.drive.samples)
        assert proposal.drive.samples.data == step.drive.samples.data
        assert [use.peak for use in proposal.drives] == np.abs(drive).max(axis=1).tolist()
        rate = proposal.drive.sample_rate
        slew = np.abs(np.diff(drive, prepend=0.0)).max(axis=1) * rate
        assert [use.slew for use in proposal.drives] == pytest.approx(slew.tolist())
        assert [use.range_share for use in proposal.drives] == pytest.approx((np.abs(drive).max(axis=1) / 0.5).tolist())
        assert [use.slew_share for use in proposal.drives] == pytest.approx((slew / 100.0).tolist())
        measured = from_array(target.samples) - from_array(step.error_in_band)
        predicted = from_array(proposal.predicted_response)
        assert np.abs(predicted - measured).max() < 0.02 * np.abs(measured).max()
        assert proposal.overall_relative_rms_error == pytest.approx(step.metrics.overall_relative_rms_error, rel=0.1)
        for response, channel in zip(proposal.responses, step.metrics.channels, strict=True):
            assert response.channel == channel.channel
            assert response.forecast.damage_ratio == pytest.approx(channel.damage_ratio, rel=0.1)
            assert response.forecast.damage_ratio == channel.forecast.damage_ratio


def test_the_status_says_what_it_waits_for_without_the_samples(lab):
    lab.start(held_campaign("shown", FIRST, iterations=2))
    shown = lab.held("shown", 1)
    status = lab.status("shown")
    assert shown.reason == "The campaign waits before its first playback"
    assert len(shown.drives) == len(shown.responses) == 2
    assert not shown.HasField("drive")
    assert status.activity.startswith(
        "waiting for a decision on proposal 1, before iteration 1 of 2: predicted error 50"
    )
    with pytest.raises(FaultError, match="is that of rig 'other'") as elsewhere:
        lab.decide("shown", 1, rig="other")
    assert (elsewhere.value.code, elsewhere.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, "rig")
    lab.decide("shown", 1)
    final = lab.end_of("shown")
    # Only before the first.
    assert (len(final.iterations), final.HasField("hold")) == (2, False)


@pytest.mark.parametrize(("bounds", "held"), [({"predicted_peak": 0.7}, True), ({"predicted_damage": 0.5}, False)])
def test_a_campaign_waits_where_the_prediction_passes_a_bound(lab, bounds, held):
    """The first drive at gain 0.5 promises about half the peak and a thirtieth of the damage; the second more."""
    id = f"bounded-{held}".lower()
    lab.start(
        held_campaign(id, iterator_pb2.HoldSettings(when=iterator_pb2.HOLD_POINT_PREDICTED, **bounds), iterations=2)
    )
    if held:
        proposal = lab.held(id, 1)
        assert proposal.playback == 2
        assert "The predicted peak of" in proposal.reason
        assert "past hold.predicted_peak of 0.7" in proposal.reason
        lab.decide(id, 1)
    assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert len(lab.recorder.read(id, iterator_pb2.Proposal)) == held


def test_a_changed_band_and_algorithm_count_from_that_playback_on(lab):
    lab.start(held_campaign("banded", iterations=4))
    driven(lab, "banded", [(1, "PLAY", {})])
    lab.held("banded", 2)
    band = iterator_pb2.ControlBand(lowest_frequency=5.0, highest_frequency=40.0)
    secant = with_gain(1.0, iterator_pb2.UPDATE_KIND_SECANT)
    secant.secant.CopyFrom(iterator_pb2.SecantSettings(forgetting=0.7, prior_strength=1.0, caution=1.0))
    driven(lab, "banded", [(2, "CHANGE", {"control_band": band, "update": secant}), (3, "PLAY", {})])
    driven(lab, "banded", [(4, "PLAY", {}), (5, "PLAY", {})])
    final = lab.end_of("banded")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    wide, narrow = lab.recorder.read("banded", iterator_pb2.TargetInBand)
    steps = lab.recorder.read("banded", iterator_pb2.IterationStep)
    assert [step.judged_target for step in steps] == [0, 1, 1, 1]
    rate, kept = steps[0].drive.sample_rate, from_array(narrow.samples)
    frequency = np.fft.rfftfreq(kept.shape[1], 1.0 / rate)
    outside = (frequency < 2.0) | (frequency > 45.0)
    for samples, share in ((from_array(wide.samples), 1e-3), (kept, 0.0), (from_array(steps[3].drive.samples), 0.0)):
        density = np.abs(np.fft.rfft(samples)) ** 2
        found = density[:, outside].sum() / density.sum()
        assert (found > share) if share else (found < 1e-6)
    assert errors_of(lab, "banded")[1:] == pytest.approx([0.0, 0.0, 0.0], abs=0.03)
    assert final.best_iteration > 1
    with pytest.raises(FaultError, match="changed its control band at a hold point"):
        lab.resume("banded", new_id="banded-2")


def test_an_end_at_a_hold_point_keeps_the_best_playback_and_moves_nothing_more(lab):
    spec = held_campaign("ended", iterations=4)
    spec.confirmations = 2
    lab.start(spec)
    driven(lab, "ended", [(1, "PLAY", {}), (2, "PLAY", {}), (3, "END", {"reason": "good enough"})])
    final = lab.end_of("ended")
    assert (final.phase, final.outcome) == (
        iterator_pb2.CAMPAIGN_PHASE_FINISHED,
        iterator_pb2.OUTCOME_ENDED_AT_HOLD_POINT,
    )
    assert (len(final.iterations), final.best_iteration, len(final.confirmations)) == (2, 2, 0)
    assert "Ended at the hold point before playback 3 by Ada: good enough." in final.remarks
    assert lab.rig_state("front").mode == rig_pb2.RIG_MODE_IDLE


def test_an_end_before_the_first_playback_is_a_stop_that_latches_nothing(lab):
    lab.start(held_campaign("unplayed", FIRST))
    driven(lab, "unplayed", [(1, "END", {"reason": "wrong specimen"})])
    final = lab.end_of("unplayed")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    assert "by Ada: wrong specimen" in final.fault.message
    assert lab.rig_state("front").mode == rig_pb2.RIG_MODE_IDLE


def test_a_stop_works_while_a_campaign_waits(lab):
    lab.start(held_campaign("stopped", rig="rear"))
    lab.held("stopped", 1)
    final = lab.stop("stopped")
    assert final.phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    assert "stopped while waiting for a decision on proposal 1" in final.fault.message
    assert not final.HasField("hold")
    assert lab.rig_state("rear").mode == rig_pb2.RIG_MODE_INTERLOCKED
    lab.reset("rear")
    with pytest.raises(FaultError, match="has ended; it waits for no decision"):
        lab.decide("stopped", 1)


def test_of_many_decisions_at_once_one_counts_and_a_stale_one_is_refused(lab):
    lab.start(held_campaign("raced", iterations=2))
    lab.held("raced", 1)

    def attempt(number):
        try:
            lab.decide("raced", 1, name=f"person {number}")
        except FaultError as fault:
            return fault
        return None

    with ThreadPoolExecutor(4) as pool:
        faults = list(pool.map(attempt, range(4)))
    refused = [fault for fault in faults if fault is not None]
    assert len(refused) == 3
    # BUSY: of those at once, a few wait for a worker and the others are asked to come again.
    assert {fault.code for fault in refused} <= {query_pb2.FAULT_CODE_FAILED_PRECONDITION, query_pb2.FAULT_CODE_BUSY}
    lab.held("raced", 2)
    with pytest.raises(FaultError, match="on proposal 1 and campaign 'raced' waits for one on proposal 2") as caught:
        lab.decide("raced", 1)
    assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "proposal")
    lab.decide("raced", 2)
    assert lab.end_of("raced").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert [decision.proposal for decision in lab.recorder.read("raced", iterator_pb2.Decision)] == [1, 2]


@pytest.fixture(scope="module")
def waiting(lab):
    """A campaign that waits for its fourth playback; it ends with its iterator."""
    spec = held_campaign("waiting", rig="rear", iterations=5)
    spec.levels.extend([0.5, 0.5, 1.0])
    lab.start(spec)
    driven(lab, "waiting", [(number, "PLAY", {}) for number in (1, 2, 3)])
    lab.held("waiting", 4)


@pytest.mark.parametrize(
    ("kind", "settings", "field", "sentence"),
    [
        ("PLAY", {"name": ""}, "name", "printable"),
        ("PLAY", {"reason": "a\x07"}, "reason", "printable"),
        ("PLAY", {"reason": "r" * 1001}, "reason", "1000"),
        ("UNSPECIFIED", {}, "kind", "offered are PLAY"),
        ("PLAY", {"from_iteration": 2}, "from_iteration", "back, and no other kind"),
        ("CHANGE", {}, "update", "needs one of the first two"),
        ("CHANGE", {"update": with_gain(1.5)}, "update.iteration_gain.0", "less than or equal to 1"),
        (
            "CHANGE",
            {"control_band": iterator_pb2.ControlBand(lowest_frequency=2.0, highest_frequency=300.0)},
            "highest_frequency",
            "half the sample rate",
        ),
        ("BACK", {"from_iteration": 4}, "from_iteration", "there are 3 to go back to"),
        ("BACK", {"from_iteration": 1}, "from_iteration", "whose successor is played at 50 %"),
    ],
)
def test_a_decision_that_cannot_be_is_refused_and_the_campaign_waits_on(lab, waiting, kind, settings, field, sentence):
    with pytest.raises(FaultError, match=sentence) as caught:
        lab.decide("waiting", 4, kind, **settings)
    assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, field)
    assert lab.status("waiting").hold.number == 4


def test_settings_that_give_no_drive_are_said_and_others_are_taken(lab, undisturbed):
    first = lab.recorder.read("undisturbed", iterator_pb2.Proposal)[0]
    # At half the gain within the limits, at the whole gain beyond them.
    scale = 0.7 / max(max(use.range_share, use.slew_share) for use in first.drives)
    spec = held_campaign("refused", iterations=2, level=(900.0 * scale, 40.0 * scale))
    spec.limit_policy = iterator_pb2.LIMIT_POLICY_REFUSE
    lab.start(spec)
    lab.held("refused", 1)
    lab.decide("refused", 1, "CHANGE", update=with_gain(1.0))
    shown = lab.held("refused", 2)
    assert "past the rig's limit of" in shown.refusal
    assert "no drive could be made with these settings" in lab.status("refused").activity
    with pytest.raises(FaultError, match="has no drive") as caught:
        lab.decide("refused", 2)
    assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "kind")
    lab.decide("refused", 2, "CHANGE", update=with_gain(0.5))
    assert not lab.held("refused", 3).refusal
    lab.decide("refused", 3)
    # Of the second drive, too: at half the gain it is half as large again.
    assert "past the rig's limit of" in lab.held("refused", 4).refusal
    driven(lab, "refused", [(4, "CHANGE", {"update": with_gain(0.2)}), (5, "PLAY", {})])
    assert lab.end_of("refused").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED


# Of the 33 steps: before or after a proposal, a decision, an announced and a played one, of each part of the script.
KILLS = [(6, False), (6, True), (7, False), (7, True), (16, True), (17, False), (17, True), (18, True), (19, True)]
KILLS += [(27, True), (28, False), (29, True), (30, True)]


@pytest.mark.parametrize(("step", "stored"), KILLS)
def test_a_campaign_killed_around_a_hold_ends_with_the_same_bytes(lab, undisturbed, step, stored):
    id = f"killed-{step}-{stored}".lower()
    lab.iterator.wait()
    with killed_at(lab, id, step, stored=stored, later=0.0) as killed, ThreadPoolExecutor(1) as pool:

        def drive():
            lab.start(held_campaign(id, iterations=5))
            driven(lab, id)

        script = pool.submit(drive)
        assert killed.wait(30.0)
        with pytest.raises(FaultError):
            script.result(30.0)
    restarted(lab)
    before = lab.recorder.steps[id][:]
    resumed(lab, id)
    decided = [decision.proposal for decision in lab.recorder.read(id, iterator_pb2.Decision)]
    driven(lab, id, [entry for entry in SCRIPT if entry[0] not in decided])
    assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert playbacks(lab, id) == undisturbed
    assert lab.recorder.steps[id][: len(before)] == before
    # The same proposals, none twice, and no motion more than one for each playback.
    assert [p.SerializeToString() for p in lab.recorder.read(id, iterator_pb2.Proposal)] == [
        p.SerializeToString() for p in lab.recorder.read("undisturbed", iterator_pb2.Proposal)
    ]
    assert len(lab.recorder.read(id, iterator_pb2.Decision)) == len(SCRIPT)
    played = [run.run for run in lab.recorder.read(id, recorder_pb2.RunPlayed)]
    assert len(played) == len(set(played)) == 6


def test_a_new_campaign_goes_on_with_what_was_decided(lab, undisturbed):
    stop = iterator_pb2.StopCriteria(iterations=6)
    lab.resume("undisturbed", new_id="taken-up", stop=stop)
    # It waits before the first playback of its own, and plays with the gains of the change.
    lab.held("taken-up", 1)
    lab.decide("taken-up", 1)
    assert lab.end_of("taken-up").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    (spec,) = lab.recorder.read("taken-up", iterator_pb2.CampaignSpec)
    assert from_array(spec.update.iteration_gain).tolist() == [0.8, 0.8]
    assert spec.scenario == "name: bolder\n"


def number_of(payload):
    return iterator_pb2.Proposal.FromString(payload).number


def restarted(lab):
    lab.iterator.end()
    lab.iterator.start()
    lab.iterator.wait()


def test_a_campaign_killed_while_it_waits_waits_again_with_the_same_proposal(lab):
    lab.start(held_campaign("asleep", iterations=2))
    driven(lab, "asleep", [(1, "PLAY", {})])
    before = lab.held("asleep", 2)
    lab.iterator.kill()
    restarted(lab)
    lab.resume("asleep")
    assert lab.held("asleep", 2) == before
    assert len(lab.recorder.read("asleep", iterator_pb2.Proposal)) == 2
    assert len(lab.recorder.read("asleep", recorder_pb2.RunPlanned)) == 2
    with pytest.raises(FaultError, match="waits for one on proposal 2"):
        lab.decide("asleep", 1)
    lab.decide("asleep", 2)
    assert lab.end_of("asleep").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED


def test_a_recorded_proposal_of_another_drive_is_decided_on_again(lab):
    """As after a crash on a machine whose last bits are others, here: as if the recording held another drive."""
    lab.start(held_campaign("moved", iterations=2))
    driven(lab, "moved", [(1, "PLAY", {})])
    lab.held("moved", 2)
    lab.decide("moved", 2, "CHANGE", update=with_gain(0.9))
    lab.held("moved", 3)
    lab.iterator.kill()
    kept = lab.recorder.steps["moved"]
    (number,) = [i for i, (kind, payload) in enumerate(kept) if kind == "Proposal" and number_of(payload) == 2]
    changed = iterator_pb2.Proposal.FromString(kept[number][1])
    data = bytearray(changed.drive.samples.data)
    data[4000] ^= 1
    changed.drive.samples.data = bytes(data)
    kept[number] = ("Proposal", changed.SerializeToString(deterministic=True))
    for shown in (4, 4):
        restarted(lab)
        lab.resume("moved")
        assert lab.held("moved", shown).replaces == 2
        # The second time it is the drive of the recording.
        lab.iterator.kill()
    restarted(lab)
    lab.resume("moved")
    lab.held("moved", 4)
    with pytest.raises(FaultError, match="waits for one on proposal 4"):
        lab.decide("moved", 3)
    lab.decide("moved", 4)
    assert lab.end_of("moved").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    # The change on the proposal that does not count any more does not count either.
    assert errors_of(lab, "moved") == pytest.approx([0.5, 0.25], rel=0.02)
    assert [proposal.number for proposal in lab.recorder.read("moved", iterator_pb2.Proposal)] == [1, 2, 3, 4]


# A decision that changes the band is stored, and its target is not; it is stored, and the proposal is not.
@pytest.mark.parametrize(("step", "stored"), [(12, True), (13, True)])
def test_a_campaign_killed_while_its_band_changes_has_each_target_once(lab, step, stored):
    id = f"rebanded-{step}"
    band = iterator_pb2.ControlBand(lowest_frequency=5.0, highest_frequency=40.0)
    with killed_at(lab, id, step, stored=stored, later=0.0) as killed:
        lab.start(held_campaign(id, iterations=2))
        driven(lab, id, [(1, "PLAY", {})])
        lab.held(id, 2)
        with suppress(FaultError):
            lab.decide(id, 2, "CHANGE", control_band=band)
        assert killed.wait(20.0)
    assert lab.recorder.kinds(id)[-1] == ("Decision" if step == 12 else "TargetInBand")
    restarted(lab)
    lab.resume(id)
    driven(lab, id, [(3, "PLAY", {})])
    assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert lab.recorder.kinds(id)[11:15] == ["Proposal", "Decision", "TargetInBand", "Proposal"]
    assert len(lab.recorder.read(id, iterator_pb2.TargetInBand)) == 2


@pytest.mark.parametrize(("simulated", "when"), [(True, "never"), (False, "first")])
def test_a_rig_that_is_no_simulation_is_held_before_its_first_playback(simulated, when):
    spec, rig = specification(), description()
    rig.simulated = simulated
    request = identifier_pb2.IdentifyRequest(rig=spec.rig, excitation=spec.excitation, estimator=spec.estimator)
    assert plan_campaign(spec, rig, experiment_plan(request)).hold.when == when
