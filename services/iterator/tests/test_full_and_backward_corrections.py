"""Adaptive Modelling beyond the paper's forward, channel-by-channel one."""

from dataclasses import replace

import numpy as np
import pytest

from duralab_settings import CorrectionPrediction, CorrectionShape, UpdateKind
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
from iterator.updates.model_correction import FullPredictionSpectra, full_correction_from_spectra

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target

# Drives have energy from 2 to 60 Hz.
BAND = control_band(3.0, 54.0, sample_rate=SAMPLE_RATE, lower_flank=1.0, upper_flank=6.0)
ERROR = np.array([1.4, 0.6])
UNGUARDED = {
    "smallest_correction": 1e-6,
    "largest_correction": 1e6,
    "weigh_by_coherence": False,
    "smooth_lines": False,
    "correction": CorrectionShape.FULL,
}


def exact_model():
    return rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))


def settings(**correction):
    return UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.5), kind=UpdateKind.ADAPTIVE_MODELLING, **correction)


def history_of(model, truth, samples=6001):
    target = BAND.limit_target(noise_target(samples))
    drive = apply_inverse(model, 0.5 * target, band=BAND)
    return IterationHistory(target=target).after(Playback(drive=drive, response=predict(truth, drive, band=BAND)))


@pytest.mark.parametrize("prediction", list(CorrectionPrediction))
@pytest.mark.parametrize("shape", list(CorrectionShape))
@pytest.mark.parametrize("weigh", [True, False])
def test_an_exact_model_is_corrected_by_one(prediction, shape, weigh):
    model = exact_model()
    # The response is cut at the record's ends, so the drive that the inverse finds for it is nearly the one played.
    inside = (model.frequency > 2.5) & (model.frequency < 57.0)
    asked = settings(prediction=prediction, correction=shape, weigh_by_coherence=weigh)
    found = estimate_correction(history_of(model, model), model, asked)
    one = 1.0 if shape is CorrectionShape.DIAGONAL else np.eye(2)
    tolerance = 1e-12 if prediction is CorrectionPrediction.FORWARD else 1e-4
    assert np.max(np.abs(found - one)[inside]) <= tolerance
    assert np.all((found == one)[~((model.frequency > 2.0) & (model.frequency < 60.0))])


def exact_spectra(truth, model, *, backward=False, blocks=20):
    """Spectra of drives that are independent at every line: no leakage, no noise."""
    rng = np.random.default_rng(8)
    lines = truth.frequency.size
    drives = rng.standard_normal((blocks, lines, 2)) + 1j * rng.standard_normal((blocks, lines, 2))
    measured = np.einsum("lij,blj->bli", truth.frf, drives)
    if backward:
        wanted, observed = drives, np.einsum("lij,blj->bli", model.inverse_frf, measured)
    else:
        wanted, observed = np.einsum("lij,blj->bli", model.frf, drives), measured
    return FullPredictionSpectra(
        predicted_with_measured=np.einsum("bli,blj->lij", wanted, observed.conj()) / blocks,
        measured=np.einsum("bli,blj->lij", observed, observed.conj()) / blocks,
        predicted=np.mean(np.abs(wanted) ** 2, axis=0),
    )


@pytest.mark.parametrize("prediction", list(CorrectionPrediction))
@pytest.mark.parametrize("side", ["drives", "responses"])
def test_one_full_correction_repairs_a_diagonal_error_on_either_side(prediction, side):
    truth = exact_model()
    if side == "drives":
        wrong = replace(truth, frf=truth.frf * ERROR, inverse_frf=truth.inverse_frf / ERROR[:, None])
    else:
        wrong = replace(truth, frf=truth.frf * ERROR[:, None], inverse_frf=truth.inverse_frf / ERROR)
    backward = prediction is CorrectionPrediction.BACKWARD
    found = full_correction_from_spectra(exact_spectra(truth, wrong, backward=backward), settings(**UNGUARDED))
    repaired = corrected(wrong, found, prediction)
    inside = truth.identified
    for mended, true in ((repaired.inverse_frf, truth.inverse_frf), (repaired.frf, truth.frf)):
        assert (
            np.max(np.abs(mended[inside] - true[inside]) / np.abs(true[inside]).max(axis=(1, 2))[:, None, None]) < 1e-9
        )


def test_backward_a_line_without_target_in_one_response_corrects_no_drive():
    model = exact_model()
    history = history_of(model, replace(model, frf=1.3 * model.frf))
    quiet = history.target.copy()
    quiet[1] = control_band(3.0, 18.0, sample_rate=SAMPLE_RATE).limit_target(quiet)[1]
    history = IterationHistory(target=quiet).after(history.playbacks[0])
    found = estimate_correction(history, model, settings(prediction=CorrectionPrediction.BACKWARD))
    above = (model.frequency > 25.0) & (model.frequency < 55.0)
    assert np.all(found[above] == 1.0)
    assert np.all(found[(model.frequency > 5.0) & (model.frequency < 15.0)] != 1.0)


def test_a_backward_diagonal_correction_repairs_an_error_on_the_drives_side():
    truth = exact_model()
    wrong = replace(truth, frf=truth.frf * ERROR, inverse_frf=truth.inverse_frf / ERROR[:, None])
    asked = settings(prediction=CorrectionPrediction.BACKWARD)
    repaired = corrected(
        wrong, estimate_correction(history_of(wrong, truth), wrong, asked), CorrectionPrediction.BACKWARD
    )
    inside = (truth.frequency > 3.0) & (truth.frequency < 54.0)
    np.testing.assert_allclose(repaired.inverse_frf[inside], truth.inverse_frf[inside], rtol=1e-3)


def test_a_full_correction_is_bounded_in_every_direction():
    truth = exact_model()
    wrong = replace(truth, frf=truth.frf * 5.0, inverse_frf=truth.inverse_frf / 5.0)
    found = full_correction_from_spectra(
        exact_spectra(truth, wrong), settings(**{**UNGUARDED, "largest_correction": 2.0, "weigh_by_coherence": True})
    )
    assert np.max(np.abs(found[truth.identified] - 2.0 * np.eye(2))) < 1e-9


def test_channels_that_are_alike_get_no_full_correction():
    spectra = exact_spectra(exact_model(), exact_model())
    alike = replace(spectra, measured=np.ones_like(spectra.measured))
    found = full_correction_from_spectra(alike, settings(**UNGUARDED))
    np.testing.assert_array_equal(found, np.broadcast_to(np.eye(2), found.shape))
