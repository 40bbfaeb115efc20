from dataclasses import replace

import numpy as np
import pytest

from duralab_settings import UpdateKind
from iterator import (
    IterationHistory,
    Playback,
    UpdateSettings,
    apply_inverse,
    control_band,
    corrected,
    estimate_correction,
    predict,
    rig_model,
)
from iterator.updates.model_correction import PredictionSpectra, correction_from_spectra

from .linear_plants import BLOCK, SAMPLE_RATE, frequency_response, impulse_responses, noise_target

# Drives have energy from 2 to 60 Hz.
BAND = control_band(3.0, 54.0, sample_rate=SAMPLE_RATE, lower_flank=1.0, upper_flank=6.0)
UNGUARDED = {"smallest_correction": 1e-6, "largest_correction": 1e6, "weigh_by_coherence": False, "smooth_lines": False}


GUARDED = {}


def settings(correction=GUARDED):
    return UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.5), kind=UpdateKind.ADAPTIVE_MODELLING, **correction)


def history_of(model, truth, *, samples=6001, noise=0.0, seed=5):
    """One playback of the drive that `model` makes, on a rig that is exactly `truth`."""
    target = BAND.limit_target(noise_target(samples))
    drive = apply_inverse(model, 0.5 * target, band=BAND)
    response = predict(truth, drive, band=BAND)
    level = noise * np.sqrt(np.mean(response**2, axis=1, keepdims=True))
    disturbed = response + level * BAND.limit_response(np.random.default_rng(seed).standard_normal(response.shape))
    return IterationHistory(target=target).after(Playback(drive=drive, response=disturbed))


def exact_model():
    return rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))


@pytest.mark.parametrize("correction", [{}, UNGUARDED])
def test_an_exact_model_is_corrected_by_one(correction):
    model = exact_model()
    found = estimate_correction(history_of(model, model), model, settings(correction))
    assert np.max(np.abs(found - 1.0)) <= 1e-12


@pytest.mark.parametrize("correction", [{}, UNGUARDED])
def test_one_update_repairs_a_diagonal_error_on_the_output_side(correction):
    truth = exact_model()
    error = np.array([1.4, 0.6])
    wrong = replace(truth, frf=truth.frf * error[:, None], inverse_frf=truth.inverse_frf / error)
    found = estimate_correction(history_of(wrong, truth), wrong, settings(correction))
    inside = (truth.frequency > 2.5) & (truth.frequency < 57.0)
    repaired = corrected(wrong, found)
    for mended, true in ((repaired.inverse_frf, truth.inverse_frf), (repaired.frf, truth.frf)):
        assert np.max(np.abs(mended[inside] / true[inside] - 1.0)) <= 1e-10


def test_one_update_repairs_a_frequency_dependent_output_error_line_by_line():
    truth = exact_model()
    rng = np.random.default_rng(8)
    lines = truth.frequency.size
    drives = rng.standard_normal((20, lines, 2)) + 1j * rng.standard_normal((20, lines, 2))
    error = np.exp(rng.uniform(-0.5, 0.5, (lines, 2)) + 1j * rng.uniform(-2.0, 2.0, (lines, 2)))
    measured = np.einsum("lij,blj->bli", truth.frf, drives)
    predicted = error * measured
    spectra = PredictionSpectra(
        predicted_with_measured=np.mean(predicted * measured.conj(), axis=0),
        predicted=np.mean(np.abs(predicted) ** 2, axis=0),
        measured=np.mean(np.abs(measured) ** 2, axis=0),
    )
    unsmoothed = {"smooth_lines": False}
    found = correction_from_spectra(spectra, settings(unsmoothed))
    np.testing.assert_allclose(found[truth.identified], error[truth.identified], rtol=1e-10)


def test_a_diagonal_error_on_the_input_side_is_not_repaired_by_a_diagonal_correction():
    truth = exact_model()
    error = np.array([1.4, 0.6])
    wrong = replace(truth, frf=truth.frf * error, inverse_frf=truth.inverse_frf / error[:, None])
    found = estimate_correction(history_of(wrong, truth), wrong, settings(UNGUARDED))
    repaired = corrected(wrong, found)
    inside = (truth.frequency > 5.0) & (truth.frequency < 50.0)
    assert np.abs(np.matmul(truth.inverse_frf[inside], repaired.frf[inside]) - np.eye(2)).max() > 0.05


def test_nothing_is_corrected_outside_the_control_band():
    truth = exact_model()
    wrong = replace(truth, frf=2.0 * truth.frf, inverse_frf=0.5 * truth.inverse_frf)
    found = estimate_correction(history_of(wrong, truth), wrong, settings())
    outside = (truth.frequency <= 2.0) | (truth.frequency >= 60.0)
    assert np.all(found[outside] == 1.0)
    assert np.all(np.abs(found[(truth.frequency > 2.5) & (truth.frequency < 57.0)] - 2.0) < 1e-9)


def test_a_line_without_target_energy_is_not_corrected():
    truth = exact_model()
    wrong = replace(truth, frf=2.0 * truth.frf, inverse_frf=0.5 * truth.inverse_frf)
    narrow = control_band(2.0, 30.0, sample_rate=SAMPLE_RATE)
    played = history_of(wrong, truth)
    quiet = IterationHistory(target=narrow.limit_target(played.target), playbacks=played.playbacks)
    found = estimate_correction(quiet, wrong, settings())
    assert np.all(found[truth.frequency > 36.0] == 1.0)
    assert np.all(np.abs(found[(truth.frequency > 4.0) & (truth.frequency < 26.0)] - 2.0) < 1e-9)


def test_the_magnitude_of_a_correction_is_bounded_and_its_phase_kept():
    truth = exact_model()
    factor = 5.0 * np.exp(0.3j)
    wrong = replace(truth, frf=factor * truth.frf, inverse_frf=truth.inverse_frf / factor)
    found = estimate_correction(history_of(wrong, truth), wrong, settings({"largest_correction": 1.5}))
    inside = (truth.frequency > 5.0) & (truth.frequency < 50.0)
    np.testing.assert_allclose(found[inside], 1.5 * np.exp(0.3j), rtol=1e-2)


def test_coherence_keeps_a_correction_away_from_noise():
    model = exact_model()
    noisy = history_of(model, model, noise=3.0)
    inside = (model.frequency > 3.0) & (model.frequency < 54.0)
    plain, weighed = (
        estimate_correction(noisy, model, settings({"weigh_by_coherence": weigh}))[inside] for weigh in (False, True)
    )
    # The model is exact, so every correction but 1 is noise; H1 from noisy responses is far too small.
    assert np.sqrt(np.mean(np.abs(weighed - 1.0) ** 2)) < 0.4 * np.sqrt(np.mean(np.abs(plain - 1.0) ** 2))


def test_a_target_too_short_to_average_over_is_refused():
    model = exact_model()
    history = history_of(model, model, samples=BLOCK + 5)
    with pytest.raises(ValueError, match=f"{BLOCK + 5} samples"):
        estimate_correction(history, model, settings())


def test_a_target_of_odd_length_just_long_enough_is_corrected():
    model = exact_model()
    history = history_of(model, model, samples=BLOCK + BLOCK // 4 + 1)
    assert np.max(np.abs(estimate_correction(history, model, settings()) - 1.0)) <= 1e-12
