"""Watched responses, confirmed results and bad input, on a rig of more responses than drives."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_loads import channel_damage
from duralab_proto.arrays import from_array, from_record, to_array
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from duralab_spectra import line_frequencies, rms
from iterator import control_band
from iterator.campaign import seeds

from ..linear_plants import SAMPLE_RATE, noise_target, play
from ..wide_rig import drives_of, impulses, model, specification, wide_lab

FINISHED, FAULTED = iterator_pb2.CAMPAIGN_PHASE_FINISHED, iterator_pb2.CAMPAIGN_PHASE_FAULTED


@pytest.fixture(scope="module")
def lab():
    with wide_lab("iterator_wide") as lab:
        yield lab


@pytest.fixture(autouse=True)
def as_it_was(lab):
    yield
    lab.rig.noise, lab.rig.failing, lab.rig.leaving, lab.rig.stuck = 0.0, "", "", (0, ())
    lab.identifier.answer = model


def ended(lab, spec):
    lab.start(spec)
    return lab.end_of(spec.id)


@pytest.mark.parametrize(
    "kind",
    [iterator_pb2.UPDATE_KIND_BASIC_TWR, iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING, iterator_pb2.UPDATE_KIND_SECANT],
)
def test_a_watched_response_without_a_target_is_measured_and_changes_nothing(lab, kind):
    spec = specification(f"watched-{kind}", iterations=6)
    spec.update.kind, spec.update.correction = kind, iterator_pb2.CORRECTION_SHAPE_FULL
    spec.stop.relative_rms_error, spec.stop.divergence_ratio = 0.1, 1.5
    final = ended(lab, spec)
    assert (final.phase, final.outcome) == (FINISHED, iterator_pb2.OUTCOME_REACHED), final.fault.message
    # Halved at each playback, with an exact model: 1/8 is above 0.1 and 1/16 below.
    assert len(final.iterations) == final.best_iteration == 4
    last = final.iterations[-1]
    assert [channel.watched for channel in last.channels] == [False, False, True]
    assert np.isnan(last.channels[2].relative_rms_error)
    assert last.overall_relative_rms_error == pytest.approx(0.0625, rel=0.02)
    step = lab.recorder.read(spec.id, iterator_pb2.IterationStep)[-1]
    assert list(step.inverse_frf.shape) == [257, 2, 3]
    assert not np.any(from_array(step.inverse_frf)[:, :, 2])
    # Its target is silent, so its error is its response.
    assert rms(from_array(step.error_in_band))[2] > 100.0


def test_three_controlled_responses_of_two_drives_converge_to_a_target_that_can_be(lab):
    drive = noise_target(8000, level=(0.01, 0.02))
    spec = specification("square", target=play(impulses(), drive), weight=(1.0, 0.5, 2.0), iterations=5)
    final = ended(lab, spec)
    assert final.phase == FINISHED, final.fault.message
    assert [channel.watched for channel in final.iterations[-1].channels] == [False] * 3
    errors = [channel.relative_rms_error for channel in final.iterations[-1].channels]
    assert errors == pytest.approx([0.5**5] * 3, rel=0.05)


@pytest.mark.parametrize("real_time", [False, True])
def test_identification_iterations_and_confirmations_are_played_in_real_time_where_that_is_asked(lab, real_time):
    spec = specification(f"paced-{real_time}".lower(), iterations=2)
    spec.confirmations, spec.real_time, lab.rig.paced = 1, real_time, []
    final = ended(lab, spec)
    assert final.phase == FINISHED, final.fault.message
    assert (lab.identifier.paced, lab.rig.paced) == (real_time, [real_time] * 3)


def test_a_result_is_confirmed_and_told_beside_the_noise_floor(lab):
    spec = specification("confirmed", iterations=3)
    spec.confirmations = 2
    lab.rig.noise, lab.rig.seeds = 1.0, []
    final = ended(lab, spec)
    assert final.phase == FINISHED, final.fault.message
    runs = [run.run for run in lab.recorder.read("confirmed", recorder_pb2.RunPlanned)]
    assert runs[-2:] == ["confirmed.confirm01", "confirmed.confirm02"]
    assert lab.recorder.kinds("confirmed")[-8:] == [
        *(2 * ["RunPlanned", "ConfirmationStep", "RunPlayed"]),
        *("CampaignStatus", "RecordingClosed"),
    ]
    assert lab.rig.seeds[-2:] == [seeds.derived_seed(11, seeds.confirmation(number)) for number in (1, 2)]
    assert len(set(lab.rig.seeds)) == 5
    steps = lab.recorder.read("confirmed", iterator_pb2.ConfirmationStep)
    # Compared as they are sent: the figures of the watched response are not a number, which equals nothing.
    told = [metrics.SerializeToString() for metrics in final.confirmations]
    assert told == [step.metrics.SerializeToString() for step in steps]
    told = final.repeatability
    assert (told.iteration, told.playbacks) == (final.best_iteration, 3)
    band = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
    share = np.sqrt(np.mean(band.drive_mask(line_frequencies(8000, SAMPLE_RATE)) ** 2))
    (target,) = lab.recorder.read("confirmed", iterator_pb2.TargetInBand)
    level = rms(from_array(target.samples))
    floors = np.array([channel.noise_floor for channel in told.channels])
    np.testing.assert_allclose(floors[:2], share / level[:2], rtol=0.05)
    assert np.isnan(floors[2])
    # The noise floor and what three playbacks at gain 0.5 leave make up the error.
    first = told.channels[0]
    assert first.systematic_error == pytest.approx(0.125, rel=0.05)
    assert first.relative_rms_error == pytest.approx(np.hypot(0.125, floors[0]), rel=0.05)


def test_nothing_is_confirmed_beyond_the_damage_budget(lab):
    spec = specification("budget", iterations=6)
    spec.confirmations, spec.stop.damage_budget = 2, 1.5
    final = ended(lab, spec)
    assert final.outcome == iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED
    assert "played 0 of 2 times again: one more playback would pass the damage budget." in final.remarks[-1]
    assert not final.HasField("repeatability")
    assert "ConfirmationStep" not in lab.recorder.kinds("budget")


def costly(lab, spec, *multiples):
    """Let the identifier state damages that are these multiples of the target's, whatever the slope."""
    target = from_record(spec.target)[2]
    damage = channel_damage(target) * np.array(multiples)[:, np.newaxis]
    damage[2] = 123.0

    def answer(request):
        made = model(request)
        made.response_damage.CopyFrom(to_array(damage))
        return made

    lab.identifier.answer = answer


def test_the_identification_counts_for_the_damage_budget_and_stands_in_every_playback(lab):
    spec = specification("costly", iterations=6)
    spec.stop.damage_budget = 4.5
    costly(lab, spec, 0.25, 2.0, 0.0)
    final = ended(lab, spec)
    # 2 by the identification and one a playback: the third would bring 5.
    assert (final.outcome, len(final.iterations)) == (iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED, 2), final.fault.message
    for metrics in final.iterations:
        told = np.array([channel.identification_damage for channel in metrics.channels])
        np.testing.assert_allclose(told[:2], [[0.25] * 3, [2.0] * 3], rtol=1e-6)
        # Its target is silent: no multiple of its damage.
        assert np.isnan(told[2]).all()
    name = final.iterations[0].channels[1].channel
    # 2^(-1/5) = 0.87.
    sentence = (
        f"The identification did 2 times the target's damage (k = 5) in {name}, the most of any controlled response; "
    )
    assert f"{sentence}at 0.87 times its levels it does one pass." in final.remarks
    assert f"{name} has taken 4 times the target's damage (k = 5), 2 of them by the identification" in final.remarks[-1]


def test_an_identification_that_used_up_the_damage_budget_is_followed_by_no_playback(lab):
    spec = specification("overspent", iterations=6)
    spec.stop.damage_budget = 2.5
    costly(lab, spec, 0.25, 2.0, 0.0)
    final = ended(lab, spec)
    assert (final.phase, final.fault.field) == (FAULTED, "stop.damage_budget")
    assert "leaves no room for a playback in stop.damage_budget of 2.5" in final.fault.message
    assert "IterationStep" not in lab.recorder.kinds("overspent")


def test_a_damage_that_is_none_makes_no_campaign(lab):
    spec = specification("negative", iterations=2)
    costly(lab, spec, -1.0, 1.0, 0.0)
    final = ended(lab, spec)
    assert (final.phase, final.fault.code) == (FAULTED, query_pb2.FAULT_CODE_DATA_LOSS)
    assert final.fault.field == "response_damage"


def test_a_model_that_states_no_damage_is_iterated_with_and_that_is_said(lab):
    final = ended(lab, specification("unstated", iterations=1))
    assert final.phase == FINISHED
    assert any("does not state the damage of its identification" in remark for remark in final.remarks)
    assert not final.iterations[0].channels[0].identification_damage


@pytest.fixture(scope="module")
def undisturbed(lab):
    spec = specification("undisturbed", iterations=3)
    assert ended(lab, spec).phase == FINISHED
    return drives_of(lab, "undisturbed")


@pytest.mark.parametrize("how", ["failing", "leaving"])
def test_a_campaign_whose_rig_fails_or_vanishes_in_a_playback_is_taken_up_where_it_was(lab, undisturbed, how):
    id = f"cut-{how}"
    setattr(lab.rig, how, f"{id}.i02")
    final = ended(lab, specification(id, iterations=3))
    assert final.phase == FAULTED
    assert "playing iteration 2 of 3 on front" in final.fault.message
    assert ("end stop" if how == "failing" else "left the bus") in final.fault.message
    assert lab.recorder.kinds(id)[-2:] == ["CampaignStatus", "RecordingClosed"]
    setattr(lab.rig, how, "")
    if how == "leaving":
        lab.rig.come()
        lab.bus.wait_for_live({("rig_sim", "front")}, 60.0)
    with pytest.raises(FaultError, match="name a new_id"):
        lab.resume(id)
    lab.resume(id, new_id=f"{id}-2")
    assert lab.end_of(f"{id}-2").phase == FINISHED
    assert drives_of(lab, f"{id}-2") == undisturbed


def test_a_rig_that_fails_while_a_result_is_confirmed_costs_no_iteration(lab, undisturbed):
    spec = specification("late", iterations=3)
    spec.confirmations = 1
    lab.rig.failing = "late.confirm01"
    final = ended(lab, spec)
    assert final.phase == FAULTED
    assert "playing confirmation 1 of 1 on front: The left piston" in final.fault.message
    lab.resume("late", new_id="late-2")
    final = lab.end_of("late-2")
    assert (final.phase, final.repeatability.playbacks) == (FINISHED, 2)
    assert drives_of(lab, "late-2") == undisturbed
    assert [run.run for run in lab.recorder.read("late-2", recorder_pb2.RunPlanned)] == ["late-2.confirm01"]


def test_a_sensor_that_sticks_ends_the_campaign_and_it_is_taken_up_before_that_playback(lab, undisturbed):
    lab.rig.stuck = (1, ["stuck.i02"])
    spec = specification("stuck", iterations=3)
    spec.confirmations = 1
    final = ended(lab, spec)
    assert (final.phase, final.outcome) == (FINISHED, iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL)
    assert "a controlled response stood still" in final.activity
    assert [step.iteration for step in lab.recorder.read("stuck", iterator_pb2.IterationStep)] == [1, 2]
    assert lab.recorder.kinds("stuck")[-4:] == ["IterationStep", "RunPlayed", "CampaignStatus", "RecordingClosed"]
    sentence = (
        "Playback 2: right_vertical stood still from 15.00 s for 25.00 s while its target moved; check the sensor and "
        "its cable, then resume from playback 1 or start anew."
    )
    assert lab.recorder.read("stuck", iterator_pb2.IterationStep)[-1].remarks[-1] == sentence
    assert sentence in final.remarks
    assert final.remarks[-1].endswith("played 0 of 1 times again: a controlled response stood still.")
    # Taken up after the playback that told nothing, it ends again, without a motion.
    lab.resume("stuck", new_id="stuck-2")
    again = lab.end_of("stuck-2")
    assert again.outcome == iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL
    assert list(again.remarks).count(sentence) == 1
    assert lab.recorder.read("stuck-2", recorder_pb2.RunPlanned) == []
    lab.resume("stuck", new_id="stuck-3", from_iteration=1)
    assert lab.end_of("stuck-3").outcome == iterator_pb2.OUTCOME_ITERATIONS_USED
    assert drives_of(lab, "stuck-3") == undisturbed


def test_a_sensor_that_sticks_while_a_result_is_confirmed_ends_it_there(lab):
    lab.rig.stuck = (0, ["unsure.confirm02"])
    spec = specification("unsure", iterations=2)
    spec.confirmations = 3
    final = ended(lab, spec)
    assert (final.phase, final.outcome) == (FINISHED, iterator_pb2.OUTCOME_ITERATIONS_USED)
    assert final.repeatability.playbacks == 2
    assert len(lab.recorder.read("unsure", iterator_pb2.ConfirmationStep)) == 2
    assert final.remarks[-1] == (
        "Confirmation 2 of 3: left_vertical stood still from 15.00 s for 25.00 s while its target moved; check the "
        "sensor and its cable, then resume to confirm the result."
    )
    lab.resume("unsure", new_id="unsure-2")
    assert lab.end_of("unsure-2").repeatability.playbacks == 4


def poison(spec):
    spec.target.samples.data = b"\xff" * len(spec.target.samples.data)


def drop_channel(spec):
    del spec.target.channels[2]
    spec.target.samples.CopyFrom(to_array(np.ones((2, 8000))))


def with_weight(*weight):
    return lambda spec: spec.update.weights.CopyFrom(to_array(np.array(weight)))


def with_gain(*gain):
    return lambda spec: spec.update.iteration_gain.CopyFrom(to_array(np.array(gain)))


@pytest.mark.parametrize(
    ("change", "field", "sentence"),
    [
        (poison, "target.samples", "nan"),
        (lambda spec: setattr(spec.target, "sample_rate", 512.0), "target.sample_rate", "512 Hz"),
        (drop_channel, "target.channels", "2 channels are left_vertical, right_vertical"),
        (with_gain(0.5, 1.2, 0.5), "update.iteration_gain.1", "1.2"),
        (with_gain(0.0, 0.5, 0.5), "update.iteration_gain.0", "greater than 0"),
        (with_weight(1.0, 1.0, 1.0), "target.samples", "or the weight 0 to watch it only"),
        (with_weight(1.0, 0.0, 0.0), "update.weights", "1 responses have a weight above 0, for 2 drives"),
        (with_weight(1.0, -1.0, 1.0), "update.weights.1", "greater than or equal to 0"),
        (with_weight(1.0, 1.0), "update.weights", "has 2 weights and 3 iteration gains"),
        (lambda spec: setattr(spec, "confirmations", 101), "confirmations", "less than or equal to 100"),
    ],
)
def test_bad_input_is_refused_at_the_start_with_its_field(lab, change, field, sentence):
    spec = specification("bad")
    change(spec)
    with pytest.raises(FaultError) as caught:
        lab.start(spec)
    assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, field)
    assert sentence in caught.value.message
    assert "bad" not in lab.recorder.steps


def of_another_rig(request):
    made = model(request)
    made.rig_content_hash = "another"
    return made


def of_other_channels(request):
    made = model(request)
    made.responses[0].name = "rear_vertical"
    return made


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [(of_another_rig, "is not the one the campaign was checked against"), (of_other_channels, "The model's responses")],
)
def test_a_model_of_another_rig_or_other_channels_is_not_iterated_with(lab, answer, sentence):
    lab.identifier.answer = answer
    id = f"foreign-{answer.__name__.replace('_', '-')}"
    final = ended(lab, specification(id))
    assert final.phase == FAULTED
    assert sentence in final.fault.message
    assert "IterationStep" not in lab.recorder.kinds(id)


def test_content_outside_the_band_and_beyond_reach_is_told_in_the_status(lab):
    # Three times what the drives' limit of 0.5 m can make of it.
    spec = specification("beyond", target=np.vstack([noise_target(8000, level=(1.5e5, 40.0)), np.zeros(8000)]))
    spec.limit_policy, spec.largest_overrun = iterator_pb2.LIMIT_POLICY_PROJECT, 20.0
    spec.stop.error_bound = spec.stop.peak_bound = spec.stop.damage_bound = np.inf
    with_gain(1.0, 1.0, 1.0)(spec)
    accepted = lab.start(spec)
    assert any(
        "outside the control band of 2 to 60 Hz" in remark and "% above" in remark for remark in accepted.remarks
    )
    final = lab.end_of("beyond")
    assert final.phase == FINISHED, final.fault.message
    (first, *_) = lab.recorder.read("beyond", iterator_pb2.IterationStep)
    assert any("is out of the rig's reach" in remark for remark in first.remarks), first.remarks
    assert set(first.remarks) <= set(final.remarks)
