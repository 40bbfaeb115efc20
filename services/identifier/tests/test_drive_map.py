"""The drive map of an identification: learned from its own record, kept with the model, and used by its prediction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import fftconvolve

from duralab_drive_map import ChosenTerm, DriveMap, LearnedDriveMap, MapTerm
from duralab_drive_map.messages import to_message as drive_map_message
from duralab_proto.arrays import from_array, to_array, to_record
from duralab_proto.v1 import identifier_pb2
from duralab_proto.v1.array_pb2 import CHANNEL_KIND_DISPLACEMENT, CHANNEL_KIND_FORCE, Channel
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, SettingsError
from duralab_spectra import rms
from identifier.bus import predict, settings_of
from identifier.excitation import ExperimentSettings, design_experiment, white
from identifier.experiment import RigUnderTest, check_against_rig, estimate_experiment
from identifier.modelling import from_message, learn_map, to_message, with_id

from .test_model_queries import RATE, model_valid

NAMES = ("vertical", "lateral")
RIG = RigUnderTest(
    name="arc",
    sample_rate=RATE,
    drives=tuple(
        Channel(name=name, unit="m", minimum=-0.1, maximum=0.1, kind=CHANNEL_KIND_DISPLACEMENT) for name in NAMES
    ),
    responses=tuple(Channel(name=f"force_{name}", unit="N") for name in NAMES),
    longest_drive_seconds=200.0,
    content_hash="abc",
)
KAPPA = 3.0
TIME = np.arange(64) / RATE
H = np.array([[1e5, 2e4], [-1e4, 4e4]])[:, :, None] * np.exp(-TIME / 0.03) * np.cos(2.0 * np.pi * 9.0 * TIME)


def play(u, *, kappa):
    v = np.array([u[0], u[1] + kappa * u[0] ** 2])
    return np.array([sum(fftconvolve(v[j], row[j])[: u.shape[1]] for j in range(2)) for row in H])


def learned(kind, estimator, *, kappa=KAPPA, rig=RIG, weight=None):
    settings = ExperimentSettings(
        kind=kind,
        drive_spectra=(white(0.5, 40.0),) * 2,
        rms=(0.01, 0.002),
        duration=80.0,
        block_samples=512,
        overlap=0.5,
        fade=1.0,
        seed=3,
        capture_blocks=2 if kind is ExcitationKind.RANDOM_ORTHOGONAL else 1,
    )
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    response = play(experiment.drive, kappa=kappa)
    response += 0.01 * rms(response)[:, None] * np.random.default_rng(1).standard_normal(response.shape)

    def estimate(drive):
        return estimate_experiment(
            EstimatorSettings(kind=estimator, block_samples=512), experiment.layout, drive=drive, response=response
        )

    first = estimate(experiment.drive)
    found = learn_map(
        experiment.drive, response, estimate=first, estimate_again=estimate, rig=rig, response_weight=weight
    )
    return first, found


@pytest.mark.parametrize(
    ("kind", "estimator"),
    [
        (ExcitationKind.RANDOM_ORTHOGONAL, EstimatorKind.H1),
        (ExcitationKind.PURE_RANDOM, EstimatorKind.LOCAL_POLYNOMIAL),
    ],
)
def test_the_arc_is_found_and_the_frf_on_mapped_drives_is_nearer_the_rig(kind, estimator):
    first, found = learned(kind, estimator)
    (term,) = found.drive_map.terms
    assert (term.follower, term.product) == (1, (0, 0))
    assert found.drive_map.static_coefficient(term) == pytest.approx(-KAPPA, rel=0.05)
    lines = first.valid
    true = np.fft.rfft(H, n=512, axis=2).transpose(2, 0, 1)[lines] * (0.01, 0.002)

    def error(estimate):
        return np.linalg.norm(estimate.frf[lines] * (0.01, 0.002) - true) / np.linalg.norm(true)

    assert error(found.model.estimate) < 0.7 * error(first)
    assert found.model.estimate.coherence[lines].mean() > first.coherence[lines].mean()


def test_a_linear_rig_keeps_its_estimate():
    first, found = learned(ExcitationKind.RANDOM_ORTHOGONAL, EstimatorKind.H1, kappa=0.0)
    assert found.drive_map.is_identity
    assert found.model.estimate is first


def test_a_force_controlled_drive_follows_nothing():
    vertical, lateral = RIG.drives
    forced = replace(RIG, drives=(vertical, Channel(name=lateral.name, unit="N", kind=CHANNEL_KIND_FORCE)))
    assert learned(ExcitationKind.RANDOM_ORTHOGONAL, EstimatorKind.H1, rig=forced)[1].drive_map.is_identity


def test_limits_that_do_not_hold_rest_get_no_map_and_a_sentence():
    vertical, lateral = RIG.drives
    off = replace(
        RIG, drives=(vertical, Channel(name=lateral.name, unit="m", minimum=0.01, maximum=0.1, kind=lateral.kind))
    )
    first, found = learned(ExcitationKind.RANDOM_ORTHOGONAL, EstimatorKind.H1, rig=off)
    assert found.drive_map.is_identity
    assert found.model.estimate is first
    assert found.remarks[-1].startswith("No drive map is used: the limits of lateral do not hold 0")


def arc_map():
    term = MapTerm(1, (0, 0), (0.15, 0.0, 0.0))
    return DriveMap(("drive_0", "drive_1"), ("m", "m"), (0.01, 0.002), (term,), RATE, 40.0)


def model_with_map():
    chosen = tuple(ChosenTerm(term, (0.0,) * 3, 10.0, 0.5) for term in arc_map().terms)
    message = drive_map_message(LearnedDriveMap(arc_map(), None, chosen, ()))
    return with_id(replace(model_valid(0.5, 40.0), drive_map=message))


def test_a_model_is_read_back_with_its_map_and_predicts_with_it():
    model = from_message(to_message(model_with_map()))
    u = np.vstack([0.01 * np.sin(2.0 * np.pi * 5.0 * np.arange(2000) / RATE), np.zeros(2000)])
    np.testing.assert_allclose(model.to_mapped(u), arc_map().to_mapped(u))
    request = identifier_pb2.PredictRequest(drive=to_record(model.drives, RATE, u))
    with_map = from_array(predict(model, request).response.samples)
    without = from_array(predict(replace(model, drive_map=None), request).response.samples)
    # H is 1: the square of 5 Hz is 10 Hz and a static part, of which a prediction holds none.
    wanted = -0.5 * 0.15 * 0.002 * np.cos(2.0 * np.pi * 10.0 * np.arange(2000) / RATE)
    middle = slice(500, 1500)
    np.testing.assert_allclose((with_map - without)[1, middle], wanted[middle], atol=0.03 * np.abs(wanted).max())
    np.testing.assert_array_equal(with_map[0], without[0])


def test_a_drive_whose_products_are_too_large_for_a_number_is_refused():
    model = from_message(to_message(model_with_map()))
    huge = np.full((2, 2000), 1e200)
    huge[:, 1::2] *= -1.0
    request = identifier_pb2.PredictRequest(drive=to_record(model.drives, RATE, huge))
    with pytest.raises(SettingsError, match=r"The drive reaches 1e\+200, .* too large for a number"):
        predict(model, request)


def test_a_model_whose_map_closes_a_cycle_is_refused():
    message = to_message(model_with_map())
    message.drive_map.terms[0].follower = 0
    message.id = ""
    message.id = to_message(with_id(replace(model_with_map(), drive_map=message.drive_map))).id
    with pytest.raises(ValueError, match="close a cycle"):
        from_message(message)


def identify_request(weight):
    request = identifier_pb2.IdentifyRequest(
        rig="arc",
        run="test",
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=0.5, highest_frequency=40.0, corner_frequency=2.0
            ),
            rms=to_array(np.array([0.01, 0.002])),
            duration=80.0,
            fade=1.0,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=512, overlap=0.5),
    )
    request.drive_map.response_weight.CopyFrom(to_array(np.array(weight)))
    return request


def test_weights_of_responses_are_checked():
    assert settings_of(identify_request([1.0, 0.0])).response_weight == (1.0, 0.0)
    with pytest.raises(SettingsError, match=r"\[1.0, -1.0\]; each must be 0 or more"):
        settings_of(identify_request([1.0, -1.0]))
    with pytest.raises(SettingsError, match="3 weights of responses were given; rig 'arc' has 2 responses"):
        check_against_rig(settings_of(identify_request([1.0, 1.0, 1.0])), RIG)
