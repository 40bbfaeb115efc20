"""Plan, levels, prediction, convergence and advice, asked over the bus of a linear rig."""

import numpy as np
import pytest
from identifier_on_the_bus import identifier_and_rigs, load_linear_rig

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_loads import channel_damage
from duralab_proto.arrays import from_array, from_record, to_array, to_record
from duralab_proto.v1 import identifier_pb2, query_pb2

LAB = "identifier_queries_test"


@pytest.fixture(scope="module")
def linear_rig():
    return load_linear_rig()


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    with (
        open_bus(BusConfig(lab=LAB), service="test") as opened,
        identifier_and_rigs(opened, LAB, tmp_path_factory.mktemp("lab"), rigs=("linear",)),
    ):
        yield opened


def request(run, **excitation):
    return identifier_pb2.IdentifyRequest(
        rig="linear",
        run=run,
        rig_seed=7,
        excitation=identifier_pb2.Excitation(
            **{
                "kind": identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL,
                "spectrum": identifier_pb2.WhitePinkSpectrum(
                    lowest_frequency=1.0, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0
                ),
                "rms": to_array(np.array([0.005, 0.005])),
                "duration": 30.0,
                "fade": 0.5,
                "seed": 1,
                "capture_blocks": 2,
                **excitation,
            }
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=1024),
    )


@pytest.fixture(scope="module")
def model(bus):
    return bus.query(bus.keys.identify("linear"), request("queries.identify"), identifier_pb2.Model)


def test_a_periodic_experiment_identifies_the_rig_and_tells_its_noise(model, linear_rig):
    frequency = from_array(model.frequency)
    band = (frequency >= model.lowest_frequency) & (frequency <= model.highest_frequency)
    true = linear_rig.true_frf(frequency[band])
    error = np.linalg.norm(from_array(model.frf)[band] - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    assert np.max(error) < 0.02
    noise = from_array(model.distortion.noise_psd)[band]
    np.testing.assert_allclose(np.mean(noise, axis=0), 2.0 * linear_rig.NOISE**2 / linear_rig.SAMPLE_RATE, rtol=0.15)
    assert [sentence.startswith("No nonlinearity beyond the noise in ") for sentence in model.verdicts] == [True] * 3
    assert not model.warnings


def test_a_plan_is_told_before_anything_moves_and_is_what_is_played(bus, model):
    wish = identifier_pb2.PlanRequest(identify=request("queries.planned"))
    plan = bus.query(bus.keys.experiment_plan(), wish, identifier_pb2.ExperimentPlan)
    assert plan == model.plan
    assert (plan.periods, plan.experiments_per_realisation) == (2, 2)
    assert plan.duration_seconds <= 30.0
    checked = request("queries.checked")
    checked.check_only = True
    answer = bus.query(bus.keys.identify(checked.rig), checked, identifier_pb2.Model)
    assert answer.plan == plan
    assert not answer.HasField("frf")
    wish.identify.excitation.rms.CopyFrom(to_array(np.array([0.005, 0.09])))
    with pytest.raises(FaultError, match="right_vertical would reach") as fault:
        bus.query(bus.keys.experiment_plan(), wish, identifier_pb2.ExperimentPlan)
    assert fault.value.field == "identify.excitation.rms"


def test_a_prediction_is_what_the_rig_answers(bus, model, linear_rig):
    generator = np.random.default_rng(4)
    lines = np.zeros((2, 4001), dtype=complex)
    lines[:, 40:320] = generator.standard_normal((2, 280)) + 1j * generator.standard_normal((2, 280))
    drive = np.fft.irfft(lines, 8000) * 0.5
    wish = identifier_pb2.PredictRequest(drive=to_record(linear_rig.DRIVES, linear_rig.SAMPLE_RATE, drive))
    answer = bus.query(bus.keys.prediction(model.id), wish, identifier_pb2.Prediction)
    channels, _, response = from_record(answer.response)
    assert [channel.name for channel in channels] == ["left_force", "right_force", "middle_force"]
    true = linear_rig.respond(drive)
    middle = slice(500, 7500)
    error = np.sqrt(np.mean((response - true)[:, middle] ** 2, axis=1) / np.mean(true[:, middle] ** 2, axis=1))
    assert np.all(error < 0.02)
    assert np.all(from_array(answer.share_outside_band) < 1e-3)
    wish.drive.sample_rate = 500.0
    with pytest.raises(FaultError, match="at 500 Hz; the model needs") as fault:
        bus.query(bus.keys.prediction(model.id), wish, identifier_pb2.Prediction)
    assert (fault.value.code, fault.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, "drive")


def convergence(bus, model, **changes):
    wish = identifier_pb2.ConvergenceRequest(
        **{"iteration_gain": to_array(np.full(3, 0.6)), "lowest_frequency": 2.0, "highest_frequency": 40.0, **changes}
    )
    return bus.query(bus.keys.convergence(model.id), wish, identifier_pb2.Convergence)


def test_convergence_is_foretold_with_its_confidence(bus, model):
    answer = convergence(bus, model)
    np.testing.assert_allclose(from_array(answer.spectral_radius), 0.4, atol=1e-6)
    bound = from_array(answer.spectral_radius_95)
    assert np.all((bound > 0.4) & (bound < 0.45))
    assert answer.converging_share == 1.0
    assert answer.sentence.startswith("It converges: ")
    same = convergence(bus, model, rig_model_id=model.id)
    np.testing.assert_allclose(from_array(same.spectral_radius), 0.4, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "field", "text"),
    [
        ({"lowest_frequency": 0.5}, "lowest_frequency", "lie within the model's, 1 to 50 Hz"),
        ({"iteration_gain": to_array(np.array([0.6, 0.6]))}, "iteration_gain", "shape"),
        ({"iteration_gain": to_array(np.array([0.6, 0.6, 1.5]))}, "iteration_gain", "above 0 to 1"),
        ({"rig_model_id": "deadbeef"}, "rig_model_id", "holds no model 'deadbeef'"),
    ],
)
def test_what_cannot_be_foretold_is_refused_with_its_field(bus, model, changes, field, text):
    with pytest.raises(FaultError, match=text) as fault:
        convergence(bus, model, **changes)
    assert fault.value.field == field


def test_levels_are_advised_from_a_target(bus, model, linear_rig):
    generator = np.random.default_rng(6)
    lines = np.zeros((2, 4001), dtype=complex)
    lines[:, 40:320] = generator.standard_normal((2, 280)) + 1j * generator.standard_normal((2, 280))
    drive = np.fft.irfft(lines, 8000)
    drive *= (np.array([0.01, 0.05]) / np.sqrt(np.mean(drive**2, axis=1)))[:, None]
    target = linear_rig.respond(np.tile(drive, 2))[:, 8000:]
    wish = identifier_pb2.AdviceRequest(
        model_id=model.id,
        target=to_record(linear_rig.RESPONSES, linear_rig.SAMPLE_RATE, target),
        lowest_frequency=2.0,
        highest_frequency=45.0,
    )
    advice = bus.query(bus.keys.level_advice(), wish, identifier_pb2.LevelAdvice)
    np.testing.assert_allclose(from_array(advice.wanted_rms), [0.01, 0.05], rtol=0.01)
    # The limit of 0.1 m over the crest factor of 4.5.
    np.testing.assert_allclose(from_array(advice.rms), [0.01, 0.1 / 4.5], rtol=0.01)
    assert "as far as its limit allows; the target needs 0.05 m" in advice.sentences[1]
    assert "limit" not in advice.sentences[0]
    # A linear rig: at this factor the same experiment does one pass in its worst response and less in the others.
    scaled = advice.one_pass_factor * np.array([0.005, 0.005])
    again = bus.query(
        bus.keys.identify("linear"), request("queries.one_pass", rms=to_array(scaled)), identifier_pb2.Model
    )
    band = (np.fft.rfftfreq(8000, 1.0 / linear_rig.SAMPLE_RATE) >= 2.0) & (
        np.fft.rfftfreq(8000, 1.0 / linear_rig.SAMPLE_RATE) <= 45.0
    )
    moving = target - target.mean(axis=1, keepdims=True)
    in_band = np.fft.irfft(np.where(band, np.fft.rfft(moving), 0.0), 8000)
    passes = from_array(again.response_damage)[:, 1] / channel_damage(in_band)[:, 1]
    assert passes.max() == pytest.approx(1.0, rel=0.1)
    assert from_array(advice.identification_damage).shape == (3, 3)
    wish.model_id = ""
    with pytest.raises(FaultError, match="identify it at a low level first") as fault:
        bus.query(bus.keys.level_advice(), wish, identifier_pb2.LevelAdvice)
    assert fault.value.field == "model_id"


def test_several_levels_are_compared(bus):
    wish = identifier_pb2.LevelsRequest(identify=request("queries.levels"), factors=to_array(np.array([2.0, 0.5])))
    progress = []
    result = bus.query(
        bus.keys.identify_levels(wish.identify.rig), wish, identifier_pb2.LevelsResult, on_progress=progress.append
    )
    assert [model.run for model in result.models] == ["queries.levels.l1", "queries.levels.l2"]
    levels = [from_array(model.excitation.rms)[0] for model in result.models]
    np.testing.assert_allclose(levels, [0.0025, 0.01])
    (difference,) = result.differences
    found, chance = from_array(difference.relative_difference), from_array(difference.expected_by_noise)
    held = found[:, 0] > 0.0
    # A linear rig is the same at every level: what differs is noise.
    assert 0.5 < np.sqrt(np.mean(found[held] ** 2) / np.mean(chance[held] ** 2)) < 1.5
    fractions = [one.fraction for one in progress]
    assert fractions == sorted(fractions)
    for factors in ([1.0], [1.0, 1.0], [0.0, 1.0]):
        wish.factors.CopyFrom(to_array(np.array(factors)))
        with pytest.raises(FaultError, match="2 to 8 different ones greater than 0") as fault:
            bus.query(bus.keys.identify_levels(wish.identify.rig), wish, identifier_pb2.LevelsResult)
        assert fault.value.field == "factors"
