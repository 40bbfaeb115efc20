import numpy as np
import pytest

from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.v1 import iterator_pb2, query_pb2
from iterator import UpdateKind
from iterator.campaign_plan import plan_campaign
from labbus import FaultError

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
        lambda s: with_target(s, lambda t: t.astype(np.float32)),
    ],
    "excitation.seed": [lambda s: setattr(s.excitation, "seed", 5)],
    "estimator.block_samples": [lambda s: setattr(s.estimator, "block_samples", 10)],
    "lowest_frequency": [
        lambda s: setattr(s, "lowest_frequency", 0.5),
        lambda s: setattr(s, "lowest_frequency", np.nan),
        lambda s: setattr(s, "lowest_frequency", 59.0),
    ],
    "highest_frequency": [
        lambda s: setattr(s, "highest_frequency", 80.0),
        lambda s: setattr(s, "highest_frequency", 101.0),
    ],
    "update.kind": [lambda s: setattr(s.update, "kind", 0)],
    "update.iteration_gain": [
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.5, 1.2]))),
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.0, 0.5]))),
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([0.5]))),
        lambda s: s.update.iteration_gain.CopyFrom(to_array(np.array([np.nan, 0.5]))),
    ],
    "update.smallest_correction": [lambda s: setattr(s.update, "smallest_correction", 0.0)],
    "stop": [
        lambda s: setattr(s.stop, "largest_iterations", 0),
        lambda s: setattr(s.stop, "relative_rms_error", -0.1),
        lambda s: setattr(s.stop, "divergence_ratio", 0.5),
    ],
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


def test_a_sound_specification_becomes_a_plan():
    spec = specification()
    plan = plan_campaign(spec, description(), experiment_plan(spec))
    assert plan.settings.update.kind is UpdateKind.ADAPTIVE_MODELLING
    assert plan.target_in_band.shape == (2, 8000)
    # The static part of the target is no matter of the iteration.
    assert np.max(np.abs(plan.target_in_band[:, :200])) < 1e-2 * np.max(np.abs(plan.target_in_band))
    assert plan.identified_band == (1.0, 70.0)


def test_the_bounds_of_a_correction_do_not_matter_to_basic_twr():
    spec = specification()
    spec.update.kind = iterator_pb2.UPDATE_KIND_BASIC_TWR
    spec.update.smallest_correction = spec.update.largest_correction = 0.0
    with_target(spec, lambda t: t[:, 3800:4001])
    assert plan_campaign(spec, description(), experiment_plan(spec)).settings.update.kind is UpdateKind.BASIC_TWR


def test_a_rig_with_fewer_responses_than_drives_is_refused():
    rig = description()
    del rig.responses[1]
    with pytest.raises(FaultError, match="at least as many responses") as caught:
        plan_campaign(specification(), rig, experiment_plan(specification()))
    assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
