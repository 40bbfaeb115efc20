"""A level that ruins the model is noticed from the identification's own record."""

import numpy as np
import pytest
from known_plants import RATE, lightly_damped, respond
from short_experiments import WHITE, settings_of

from duralab_settings import EstimatorKind, ExcitationKind
from identifier.estimators import estimate
from identifier.excitation import design_experiment
from identifier.uncertainty import check_level, level_sentence, separate_distortion

PLANT = lightly_damped(0.2)


def played(level, *, curvature=0.0, noise=0.0, seed=11, kind=ExcitationKind.RANDOM_ORTHOGONAL):
    """Return an experiment with a rig whose second response holds the square of its first drive, as on an arc."""
    changes = {"capture_blocks": 2, "delay_blocks": 1} if kind.is_multisine else {}
    settings = settings_of(
        drives=2, drive_spectra=(WHITE, WHITE), rms=(level, 0.1), duration=60.0, seed=seed, kind=kind, **changes
    )
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    drive = experiment.drive
    bent = drive.copy()
    bent[1] += curvature * drive[0] ** 2
    response = respond(bent, PLANT)
    response += noise * np.random.default_rng(seed).standard_normal(response.shape)
    return experiment, response - np.mean(response, axis=1, keepdims=True)


def checked(experiment, response, *, kind=EstimatorKind.H1, separate=True):
    layout = experiment.layout
    found = estimate(kind, experiment.drive, response, layout)
    noise = None
    if separate and layout.periodic:
        levels = separate_distortion(experiment.drive, response, layout)
        noise = levels.noise_psd / levels.periods
    check = check_level(
        lines=found.valid,
        residual_psd=found.unexplained_psd,
        response_psd=found.response_psd,
        random_share=2.0 / np.where(found.valid, found.averages, 1.0),
        noise_psd=noise,
    )
    return check, found


def missed(found, experiment, response):
    """Relative RMS by which an FRF misses the periods of another record."""
    layout = experiment.layout
    error, total = 0.0, 0.0
    for capture in layout.captures:
        used = slice(capture.start, capture.start + capture.periods * layout.block_samples)
        u, y = (
            np.fft.rfft(record[:, used].reshape(2, capture.periods, -1).mean(axis=1), axis=1)[:, layout.excited]
            for record in (experiment.drive, response)
        )
        error += np.sum(np.abs(y - np.einsum("fij,jf->if", found.frf[layout.excited], u)) ** 2, axis=1)
        total += np.sum(np.abs(y) ** 2, axis=1)
    return np.sqrt(error / total)


@pytest.mark.parametrize(("curvature", "noise"), [(0.1, 0.0), (0.3, 0.0), (0.0, 0.02), (0.1, 0.02)])
def test_the_miss_is_that_of_another_record_of_the_level(curvature, noise):
    check, found = checked(*played(1.0, curvature=curvature, noise=noise))
    others = [missed(found, *played(1.0, curvature=curvature, noise=noise, seed=seed)) for seed in (12, 13, 14)]
    np.testing.assert_allclose(check.miss, np.mean(others, axis=0), rtol=0.2)


@pytest.mark.parametrize("kind", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.PURE_RANDOM])
def test_a_good_level_is_not_called_ruined_and_one_that_is_eight_times_as_high_is(kind):
    good, _ = checked(*played(0.5, curvature=0.1, kind=kind))
    ruined, _ = checked(*played(4.0, curvature=0.1, kind=kind))
    assert not good.ruined.any()
    assert ruined.ruined.any()


def test_distortion_that_ruins_the_model_asks_for_a_lower_level_of_the_drive_that_uses_its_range():
    check, _ = checked(*played(4.0, curvature=0.1))
    sentence = level_sentence(check, drive_rms=np.array([4.0, 0.1]), room=np.array([20.0, 20.0]))
    assert "most of it is distortion: lower the level of drive 0 (4 RMS) to " in sentence
    assert "drive 1" not in sentence


def test_noise_that_ruins_the_model_asks_for_a_higher_level():
    check, _ = checked(*played(0.01, noise=0.1))
    assert check.ruined.any()
    sentence = level_sentence(check, drive_rms=np.array([0.01, 0.1]), room=np.array([1.0, 1.0]))
    assert "most of it is noise: raise the level of drive 1 (0.1 RMS)" in sentence


def test_where_noise_and_distortion_are_not_told_apart_the_sentence_says_so():
    check, _ = checked(*played(4.0, curvature=0.1, kind=ExcitationKind.PURE_RANDOM))
    sentence = level_sentence(check, drive_rms=np.ones(2), room=np.ones(2))
    assert "noise, distortion and leakage together; lower the level of drive 0 (1 RMS) and drive 1 (1 RMS)" in sentence


def test_the_largest_factor_leads_to_a_small_miss_where_distortion_grows_with_the_level():
    level = 4.0
    check, _ = checked(*played(level, curvature=0.1))
    lower, _ = checked(*played(level * check.largest_factor, curvature=0.1))
    assert check.largest_factor < 0.5
    assert np.max(lower.miss) < np.max(check.miss)
    assert not lower.ruined.any()


def test_a_level_that_did_not_ruin_the_model_is_never_advised_to_fall():
    check, _ = checked(*played(0.7, curvature=0.1))
    assert not check.ruined.any()
    assert check.largest_factor >= 1.0


def test_a_rig_without_distortion_sets_no_bound():
    check, _ = checked(*played(1.0))
    assert check.largest_factor > 1e3
