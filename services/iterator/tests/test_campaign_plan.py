import re
from types import SimpleNamespace

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2
from duralab_settings import LimitPolicy, SecantSettings, StopCriteria, UpdateKind
from iterator.campaign import plan_campaign
from iterator.campaign.confirmation import judge_confirmation, recorded_confirmation
from iterator.campaign.messages import channel_metrics

from .linear_plants import BLOCK
from .linear_rig import description, experiment_plan, specification


def with_target(spec, change):
    samples = np.array(from_array(spec.target.samples))
    spec.target.samples.CopyFrom(to_array(np.ascontiguousarray(change(samples))))


def silenced(samples):
    samples[1] = 500.0
    return samples


def poisoned(samples):
    samples[1, 17] = np.nan
    return samples


def swap_channels(spec):
    first, second = spec.target.channels
    first.name, second.name = second.name, first.name


def secant_that_forgets_nothing_or_more(spec):
    spec.update.kind = iterator_pb2.UPDATE_KIND_SECANT
    spec.update.secant.forgetting = 1.5


def with_band_from(spec, lowest):
    spec.lowest_frequency, spec.excitation.spectrum.lowest_frequency = lowest, 0.5 * lowest


def at_target(spec, *, level=0.5, duration=40.0, kind=identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL):
    spec.at_target.level, spec.at_target.duration = level, duration
    spec.excitation.kind = kind


def with_curve(spec, frequency, share):
    spec.update.gain_curve_frequency.CopyFrom(to_array(np.array(frequency)))
    spec.update.gain_curve_share.CopyFrom(to_array(np.array(share)))


MISTAKES = {
    "target.channels": [
        swap_channels,
        lambda s: setattr(s.target.channels[0], "unit", "kN"),
        lambda s: setattr(s.target.channels[0], "name", "left_lateral"),
    ],
    "target.sample_rate": [lambda s: setattr(s.target, "sample_rate", 512.0)],
    "target": [lambda s: s.ClearField("target")],
    "target.samples": [
        lambda s: with_target(s, lambda t: t[:, :0]),
        lambda s: with_target(s, lambda t: np.tile(t, 4)),
        lambda s: with_target(s, lambda t: t[:, : BLOCK + 10]),
        lambda s: with_target(s, silenced),
        lambda s: with_target(s, poisoned),
        # Finite, but neither its transform nor its square is.
        lambda s: with_target(s, lambda t: np.where(t == t.max(), -1e308, t)),
        lambda s: with_target(s, lambda t: t.astype(np.float32)),
    ],
    "at_target.level": [lambda s: at_target(s, level=0.0), lambda s: at_target(s, level=1.1)],
    "at_target.duration": [lambda s: at_target(s, duration=0.0), lambda s: at_target(s, duration=np.nan)],
    "at_target": [lambda s: at_target(s, kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM)],
    "excitation.seed": [lambda s: setattr(s.excitation, "seed", 5)],
    "estimator.block_samples": [lambda s: setattr(s.estimator, "block_samples", 10)],
    "lowest_frequency": [
        lambda s: setattr(s, "lowest_frequency", 0.5),
        lambda s: setattr(s, "lowest_frequency", np.nan),
        lambda s: setattr(s, "lowest_frequency", 60.0),
        # The excitation begins at 1 Hz.
        lambda s: setattr(s, "lowest_frequency", 1.05),
        lambda s: setattr(s, "lower_flank", 1.2),
        # A period of 40.4 s in a target of 40 s, and one that no memory would hold.
        lambda s: with_band_from(s, 0.02475),
        lambda s: with_band_from(s, 1e-12),
    ],
    "highest_frequency": [
        lambda s: setattr(s, "highest_frequency", 80.0),
        lambda s: setattr(s, "highest_frequency", 101.0),
    ],
    "lower_flank": [lambda s: setattr(s, "lower_flank", -1.0)],
    "largest_overrun": [lambda s: setattr(s, "largest_overrun", 0.9)],
    "update.kind": [lambda s: setattr(s.update, "kind", 0)],
    "update.iteration_gain.1": [lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.5, 1.2])))],
    "update.iteration_gain.0": [lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.0, 0.5])))],
    "update.iteration_gain": [
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.5]))),
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([np.nan, 0.5]))),
    ],
    "update.prediction": [lambda s: setattr(s.update, "prediction", 9)],
    "update.correction": [lambda s: setattr(s.update, "correction", 9)],
    "update.secant.forgetting": [secant_that_forgets_nothing_or_more],
    "update.gain_schedule.1": [lambda s: s.update.gain_schedule.extend([0.5, 0.0])],
    "update.gain_curve_frequency": [lambda s: s.update.gain_curve_frequency.CopyFrom(to_array(np.array([5.0])))],
    "update.gain_curve_share.1.1": [lambda s: with_curve(s, [5.0, 50.0], [[0.5, 0.5], [0.5, 1.5]])],
    "levels": [lambda s: s.levels.append(0.5), lambda s: s.levels.extend([0.2, 0.4, 0.6, 1.0])],
    "limit_policy": [lambda s: setattr(s, "limit_policy", 9)],
    "update.smallest_correction": [lambda s: setattr(s.update, "smallest_correction", 0.0)],
    "stop.peak_bound": [lambda s: setattr(s.stop, "peak_bound", 0.5)],
    "stop.error_bound": [lambda s: setattr(s.stop, "error_bound", np.nan)],
    "stop.iterations": [lambda s: setattr(s.stop, "iterations", 0)],
    "stop.relative_rms_error": [lambda s: setattr(s.stop, "relative_rms_error", -0.1)],
    "stop.divergence_ratio": [lambda s: setattr(s.stop, "divergence_ratio", 0.5)],
    "stop.damage_ratio.1": [lambda s: setattr(s.stop, "smallest_damage_ratio", 0.8)],
    "stop.smallest_improvement": [lambda s: setattr(s.stop, "smallest_improvement", 1.0)],
    "stop.damage_budget": [lambda s: setattr(s.stop, "damage_budget", -1.0)],
    "stop.damage_exponent": [lambda s: setattr(s.stop, "damage_exponent", 4.0)],
}


@pytest.mark.parametrize(
    ("field", "mistake"), [(field, mistake) for field, mistakes in MISTAKES.items() for mistake in mistakes]
)
def test_a_wrong_value_is_refused_with_its_field_and_one_sentence(field, mistake):
    spec = specification()
    mistake(spec)
    with pytest.raises((FaultError, ArrayError)) as caught:
        plan_campaign(spec, description(), experiment_plan(spec))
    assert caught.value.field == field
    assert str(caught.value).endswith(".")


def test_an_experiment_at_the_target_needs_a_first_model_that_states_its_uncertainty():
    spec = specification()
    at_target(spec)
    spec.estimator.kind = identifier_pb2.ESTIMATOR_KIND_H1
    experiment = experiment_plan(spec)
    experiment.realisations = 1
    with pytest.raises(FaultError, match="2 experiments for 2 drives, from which h1 cannot") as caught:
        plan_campaign(spec, description(), experiment)
    assert caught.value.field == "at_target"
    experiment.experiments_per_realisation = 3
    plan_campaign(spec, description(), experiment)
    experiment.experiments_per_realisation = 2
    spec.estimator.kind = identifier_pb2.ESTIMATOR_KIND_LOCAL_POLYNOMIAL
    plan_campaign(spec, description(), experiment)


def test_a_sound_specification_becomes_a_plan():
    spec = specification()
    plan = plan_campaign(spec, description(), experiment_plan(spec))
    assert plan.settings.update.kind is UpdateKind.ADAPTIVE_MODELLING
    assert plan.target_in_band.shape == (2, 8000)
    # The static part of the target is no matter of the iteration.
    assert np.max(np.abs(plan.target_in_band[:, :200])) < 1e-2 * np.max(np.abs(plan.target_in_band))
    assert plan.identified_band == (1.0, 70.0)


def test_a_band_from_the_longest_period_that_the_target_holds_is_allowed():
    spec = specification()
    with_band_from(spec, 0.025)
    assert plan_campaign(spec, description(), experiment_plan(spec)).settings.update.band.lowest == 0.025


def test_a_band_that_rings_longer_than_memory_holds_is_refused_for_a_long_target_too():
    spec, rig = specification(), description()
    rig.longest_drive_seconds = 3600.0
    with_target(spec, lambda t: np.tile(t, 90))
    # Nearly two periods in an hour.
    with_band_from(spec, 0.0005)
    with pytest.raises(FaultError, match=r"rings for 8e\+06 samples; 5242880 are the most") as caught:
        plan_campaign(spec, rig, experiment_plan(spec))
    assert caught.value.field == "lowest_frequency"


def test_all_settings_of_update_and_end_reach_the_core():
    spec = specification()
    update, stop = spec.update, spec.stop
    update.kind, update.accept_segments = iterator_pb2.UPDATE_KIND_SECANT, True
    update.secant.forgetting, update.secant.prior_strength = 0.6, 0.4
    update.secant.caution, update.secant.regularisation = 0.2, 1e-4
    update.secant.odd_terms, update.secant.whole_record = False, True
    update.gain_schedule.extend([0.7, 1.0])
    with_curve(spec, [5.0, 50.0], [[1.0, 0.5], [0.5, 0.5]])
    stop.smallest_damage_ratio, stop.largest_damage_ratio, stop.damage_exponent = 0.8, 1.25, 8.0
    stop.damage_budget, stop.smallest_improvement, stop.improvement_playbacks = 5.0, 0.02, 3
    spec.levels.extend([0.5, 1.0])
    spec.limit_policy = iterator_pb2.LIMIT_POLICY_PROJECT
    plan = plan_campaign(spec, description(), experiment_plan(spec))
    made = plan.settings.update
    assert (made.kind, made.accept_segments, made.gain_schedule) == (UpdateKind.SECANT, True, (0.7, 1.0))
    assert made.secant == SecantSettings(
        forgetting=0.6,
        prior_strength=0.4,
        caution=0.2,
        regularisation=1e-4,
        odd_terms=False,
        rate_limits=False,
        whole_record=True,
    )
    assert (made.gain_curve_frequency, made.gain_curve_share) == ((5.0, 50.0), ((1.0, 0.5), (0.5, 0.5)))
    assert plan.settings.stop == StopCriteria(
        iterations=3,
        damage_ratio=(0.8, 1.25),
        damage_exponent=8,
        smallest_improvement=0.02,
        improvement_playbacks=3,
        damage_budget=5.0,
    )
    assert (plan.settings.levels, plan.settings.limit_policy) == ((0.5, 1.0), LimitPolicy.PROJECT)


def test_what_is_left_out_is_what_older_specifications_meant():
    plan = plan_campaign(specification(), description(), experiment_plan(specification()))
    update, stop = plan.settings.update, plan.settings.stop
    assert (update.accept_segments, update.gain_schedule, update.gain_curve_frequency) == (False, (), None)
    assert stop == StopCriteria(iterations=3)
    assert (plan.settings.levels, plan.settings.limit_policy) == ((), LimitPolicy.REFUSE)


def test_the_share_of_the_target_outside_the_band_is_told():
    spec = specification()
    # White noise up to 100 Hz against a band of 2 to 60 Hz: four tenths lie above.
    plan = plan_campaign(spec, description(), experiment_plan(spec))
    told = [float(share) for share in re.findall(r"([\d.]+) % above", plan.remarks[0])]
    assert told == pytest.approx([42.0, 42.0], abs=4.0)
    # The same figure is in the metrics of every playback; what lies below the band counts too.
    metrics = judge_confirmation(plan.target_in_band, plan.target_in_band, plan=plan)
    shares = [channel.target_energy_outside_band for channel in channel_metrics(metrics, plan=plan)]
    below = [float(share) for share in re.findall(r"([\d.]+) % below", plan.remarks[0])]
    assert 100.0 * np.array(shares) == pytest.approx(np.array(told) + below, abs=0.11)


def test_a_static_part_and_a_drift_that_are_not_reproduced_are_told_with_their_size():
    spec = specification()
    # At rest the rig carries 3600 N and 20 N; the target rests at 500 N.
    remarks = plan_campaign(spec, description(), experiment_plan(spec)).remarks
    assert [remark for remark in remarks if "static" in remark] == [
        "The static part of the target is not reproduced, the rig keeps what it carries at rest; it differs by "
        "-3100 N in left_vertical, +480 N in right_vertical."
    ]
    with_target(spec, lambda t: t - 500.0 + np.array([[3600.0], [20.0]]) + np.linspace([0, -150.0], [0, 150.0], 8000).T)
    (drift,) = (r for r in plan_campaign(spec, description(), experiment_plan(spec)).remarks if "static" in r)
    # Both levels are means over 1.5 s of 40 s each, which the line between them is shorter by.
    assert "drifts by +" in drift
    assert "left_vertical" not in drift
    assert float(re.findall(r"\+([\d.]+) N in right_vertical", drift)[0]) == pytest.approx(300.0, rel=0.1)


def test_the_bounds_of_a_correction_do_not_matter_to_basic_twr():
    spec = specification()
    spec.update.kind = iterator_pb2.UPDATE_KIND_BASIC_TWR
    spec.update.smallest_correction = spec.update.largest_correction = 0.0
    with_target(spec, lambda t: t[:, 3800:4001])
    assert plan_campaign(spec, description(), experiment_plan(spec)).settings.update.kind is UpdateKind.BASIC_TWR


@pytest.mark.parametrize("speed", [-1.0, float("nan"), float("inf")])
def test_a_speed_that_no_actuator_has_is_refused(speed):
    rig = description()
    rig.drives[1].actuator_speed = speed
    with pytest.raises(FaultError) as caught:
        plan_campaign(specification(), rig, experiment_plan(specification()))
    assert caught.value.field == "rig"
    assert f"states an actuator_speed of {speed:g} " in str(caught.value)


def test_the_speed_that_a_rig_states_reaches_the_core():
    rig = description()
    rig.drives[1].actuator_speed = 2.5
    assert plan_campaign(specification(), rig, experiment_plan(specification())).limits.actuator_speed.tolist() == [
        0.0,
        2.5,
    ]


def test_a_rig_with_fewer_responses_than_drives_is_refused():
    rig = description()
    del rig.responses[1]
    with pytest.raises(FaultError, match="at least as many responses") as caught:
        plan_campaign(specification(), rig, experiment_plan(specification()))
    assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION


def test_a_confirmation_that_was_recorded_damaged_is_a_loss_of_data():
    plan = SimpleNamespace(target_in_band=np.zeros((2, 10)))
    step = iterator_pb2.ConfirmationStep(number=3)
    step.response.samples.CopyFrom(to_array(np.zeros((2, 9))))
    with pytest.raises(FaultError, match="Confirmation 3 was recorded damaged") as fault:
        recorded_confirmation(step, plan=plan)
    assert fault.value.code == query_pb2.FAULT_CODE_DATA_LOSS
