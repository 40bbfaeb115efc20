import numpy as np
import pytest

from iterator import IterationHistory, apply_inverse, control_band, predict, rig_model
from iterator.updates.basic_twr import response_scale

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)


def model_of(h):
    return rig_model(*frequency_response(h), identified_band=(1.0, 70.0))


def test_prediction_is_what_the_plant_plays():
    h = impulse_responses()
    drive = BAND.limit_target(noise_target(4001, level=(0.01, 0.02)))
    played = BAND.limit_response(play(h, drive))
    error = predict(model_of(h), drive, band=BAND) - played
    assert np.sqrt(np.mean(error**2) / np.mean(played**2)) < 1e-4


@pytest.mark.parametrize("samples", [8000, 8001, 5999])
def test_the_inverse_of_any_length_undoes_the_plant_without_wrapping_around(samples):
    h = impulse_responses()
    wanted = BAND.limit_target(noise_target(samples))
    drive = apply_inverse(model_of(h), wanted, band=BAND)
    assert drive.shape == (2, samples)
    error = play(h, drive) - wanted
    assert np.max(np.sqrt(np.mean(error**2, axis=1) / np.mean(wanted**2, axis=1))) < 3e-4
    # The target rests at both ends: what wraps around would show there.
    assert np.max(np.abs(drive[:, : samples // 50])) < 1e-3 * np.max(np.abs(drive))


def test_a_pure_delay_is_inverted_by_playing_earlier():
    delay = np.zeros((1, 1, 8))
    delay[0, 0, 5] = 2.0
    wanted = BAND.limit_target(noise_target(8001, level=(1.0,)))
    drive = apply_inverse(model_of(delay), wanted, band=BAND)
    assert np.max(np.abs(2.0 * drive[0, :-5] - wanted[0, 5:])) < 1e-5 * np.max(np.abs(wanted))


def test_garbage_outside_the_identified_band_does_not_reach_the_drive():
    h = impulse_responses()
    frequency, frf = frequency_response(h)
    wanted = BAND.limit_target(noise_target(4001))
    clean = apply_inverse(model_of(h), wanted, band=BAND)
    garbage = frf.copy()
    garbage[(frequency < 1.0) | (frequency > 70.0)] = np.random.default_rng(3).normal(0.0, 1e9, (2, 2))
    garbage[0] = np.nan
    np.testing.assert_array_equal(
        apply_inverse(rig_model(frequency, garbage, identified_band=(1.0, 70.0)), wanted, band=BAND), clean
    )


def test_more_responses_than_drives_are_fitted_in_the_weighted_least_squares_sense():
    h = impulse_responses()
    frequency, frf = frequency_response(h)
    weight = np.array([1e-3, 1.0])
    model = rig_model(frequency, frf[:, :, :1], identified_band=(1.0, 70.0), response_weight=weight)
    for line in (20, 90):
        expected = np.linalg.lstsq(weight[:, None] * frf[line, :, :1], np.diag(weight), rcond=None)[0]
        np.testing.assert_allclose(model.inverse_frf[line], expected, rtol=1e-10)


def test_a_square_model_is_inverted_whatever_its_units():
    frequency, frf = frequency_response(impulse_responses())
    responses, drives = np.array([1e7, 1e-9])[:, None], np.array([1e-6, 1e6])
    plain = rig_model(frequency, frf, identified_band=(1.0, 70.0))
    scaled = rig_model(frequency, responses * frf / drives, identified_band=(1.0, 70.0))
    np.testing.assert_allclose(scaled.inverse_frf, drives[:, None] * plain.inverse_frf / responses.T, rtol=1e-9)


def test_a_singular_line_is_refused_with_its_frequency():
    frequency, frf = frequency_response(impulse_responses())
    frf[40, 1] = frf[40, 0]
    with pytest.raises(ValueError, match=f"{frequency[40]:g} Hz"):
        rig_model(frequency, frf, identified_band=(1.0, 70.0))


def test_a_control_band_beyond_the_identified_one_is_refused():
    h = impulse_responses()
    model = rig_model(*frequency_response(h), identified_band=(5.0, 50.0))
    with pytest.raises(ValueError, match="from 1 to 66 Hz, past the model"):
        predict(model, np.zeros((2, 100)), band=BAND)


def test_a_control_band_of_another_sample_rate_is_refused():
    band = control_band(2.0, 60.0, sample_rate=2.5 * SAMPLE_RATE)
    with pytest.raises(ValueError, match="one sample rate"):
        predict(model_of(impulse_responses()), np.zeros((2, 100)), band=band)


@pytest.mark.parametrize("weight", [[1.0, -1.0], [1.0, np.inf], [np.nan, 1.0], [1.0]])
def test_a_weight_is_one_finite_number_of_0_or_more_for_each_response(weight):
    frequency, frf = frequency_response(impulse_responses())
    with pytest.raises(ValueError, match="they must be 2 finite values of 0 or more"):
        rig_model(frequency, frf, identified_band=(1.0, 70.0), response_weight=np.array(weight))


@pytest.mark.parametrize("weight", [None, [1.0, 0.5]])
def test_a_controlled_response_whose_target_does_not_move_is_named(weight):
    frequency, frf = frequency_response(impulse_responses())
    given = None if weight is None else np.array(weight)
    model = rig_model(frequency, frf, identified_band=(1.0, 70.0), response_weight=given)
    target = noise_target(4001)
    target[1] = 0.0
    with pytest.raises(ValueError, match="The target of response 1 does not move"):
        response_scale(IterationHistory(target, ()), model)


def test_a_response_that_no_drive_reaches_is_refused_as_singular():
    frequency, frf = frequency_response(impulse_responses())
    frf = frf.copy()
    frf[:, 1] = 0.0
    with pytest.raises(ValueError, match="The FRF is singular at"):
        rig_model(frequency, frf, identified_band=(1.0, 70.0))
