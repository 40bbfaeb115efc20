import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import CubicSpline

from duralab_loads import channel_damage
from duralab_spectra import line_frequencies
from identifier.uncertainty import (
    ValidBand,
    advise_levels,
    damage_at_levels,
    difference_sentences,
    model_difference,
    predict_response,
)

RATE, BLOCK = 200.0, 512
BAND = ValidBand(lowest=1.0, highest=60.0, sample_rate=RATE, block_samples=BLOCK)
FREQUENCY = line_frequencies(BLOCK, RATE)
PLANT = [[([1.0, 0.5], [1.0, -0.6]), ([0.0, 0.3], [1.0, 0.2])], [([0.4], [1.0, -0.3]), ([0.0, 2.0], [1.0, -0.5])]]
FRF = np.array([[signal.freqz(*cell, worN=2 * np.pi * FREQUENCY / RATE)[1] for cell in row] for row in PLANT])
FRF = np.ascontiguousarray(FRF.transpose(2, 0, 1))
NONE = {"residual_psd": np.zeros((257, 2)), "row_covariance": np.zeros((257, 2, 2), dtype=complex)}


def noise_in(lowest, highest, *, channels=2, samples=8001, seed=0):
    sos = signal.butter(6, [lowest, highest], "bandpass", fs=RATE, output="sos")
    record = signal.sosfilt(sos, np.random.default_rng(seed).standard_normal((channels, samples)), axis=1)
    # A drive that begins and ends at rest: what the rig goes on answering after it is not asked for.
    return record * signal.windows.tukey(samples, 0.2)


def respond(drive):
    return np.stack([sum(signal.lfilter(*cell, drive[j]) for j, cell in enumerate(row)) for row in PLANT])


def test_a_linear_plant_answers_as_predicted_and_without_its_static_part():
    drive = noise_in(5.0, 40.0)
    found = predict_response(drive + 3.0, FRF, band=BAND, **NONE)
    true = respond(drive)
    error = np.sqrt(np.mean((found.response - true) ** 2, axis=1) / np.mean(true**2, axis=1))
    assert np.all(error < 3e-3)
    assert np.all(found.share_outside_band < 1e-3)
    np.testing.assert_array_equal(found.uncertainty_rms, 0.0)


def delayed(drive, seconds):
    late = round(seconds * RATE)
    return np.concatenate([np.zeros((drive.shape[0], late)), drive[:, :-late]], axis=1)


@pytest.mark.parametrize(("seconds", "allowed"), [(0.1, 2e-4), (0.25, 2e-3)])
def test_what_a_rig_answers_late_is_predicted_whole(seconds, allowed):
    # A straight line between lines 0.39 Hz apart leaves sinc^2 of it: 0.5 % is missing at 0.1 s, 3 % at 0.25 s.
    drive = noise_in(10.0, 25.0)
    frf = np.exp(-2j * np.pi * FREQUENCY * seconds)[:, None, None] * np.eye(2) * BAND.lines[:, None, None]
    true = delayed(drive, seconds)
    found = predict_response(drive, frf, band=BAND, **NONE)
    assert np.sqrt(np.mean((found.response - true) ** 2) / np.mean(true**2)) < allowed
    # What an odd multisine left out was laid straight, and is passed over.
    laid = BAND.lines & (np.arange(257) % 2 == 0)
    laid[[np.flatnonzero(BAND.lines)[0], np.flatnonzero(BAND.lines)[-1]]] = False
    straight = frf.copy()
    straight[laid] = (frf[np.flatnonzero(laid) - 1] + frf[np.flatnonzero(laid) + 1]) / 2.0
    found = predict_response(drive, straight, band=BAND, laid=laid, **NONE)
    assert np.sqrt(np.mean((found.response - true) ** 2) / np.mean(true**2)) < 20.0 * allowed


def test_a_late_response_needs_no_larger_drive():
    drive = noise_in(5.0, 40.0)
    frf = np.exp(-2j * np.pi * FREQUENCY * 0.25)[:, None, None] * np.eye(2) * BAND.lines[:, None, None]
    advice = advise_levels(delayed(drive, 0.25), frf, band=BAND, room=np.full(2, 100.0))
    np.testing.assert_allclose(advice.wanted_rms, np.sqrt(np.mean(drive**2, axis=1)), rtol=2e-3)


def test_a_spline_passes_through_its_lines_and_holds_the_last_one_to_the_edge():
    band = ValidBand(lowest=1.0, highest=10.05, sample_rate=100.0, block_samples=1000)
    frequency = line_frequencies(1000, 100.0)
    frf = np.where(band.lines, 1.0 / (4.0 + 1j * frequency), np.nan)
    inside = np.linspace(1.0, 10.0, 777)
    np.testing.assert_allclose(band.curved_between_lines(frf, inside), 1.0 / (4.0 + 1j * inside), atol=1e-7)
    np.testing.assert_allclose(band.curved_between_lines(frf, np.array([10.0, 10.05])), frf[[100, 100]])
    # One line, and a band of which every line was laid.
    one = ValidBand(lowest=4.95, highest=5.05, sample_rate=100.0, block_samples=1000)
    np.testing.assert_array_equal(one.curved_between_lines(frf, np.array([4.95, 5.0, 5.02])), frf[[50, 50, 50]])
    two = ValidBand(lowest=4.95, highest=5.15, sample_rate=100.0, block_samples=1000)
    found = two.curved_between_lines(frf, np.array([4.95, 5.05]), laid=band.lines)
    np.testing.assert_allclose(found, [frf[50], (frf[50] + frf[51]) / 2.0])


def test_what_lies_outside_the_band_is_told_and_not_predicted():
    outside = noise_in(70.0, 90.0)
    drive = np.stack([outside[0], noise_in(5.0, 40.0)[1]])
    found = predict_response(drive, FRF, band=BAND, **NONE)
    assert found.share_outside_band[0] > 0.99
    assert found.share_outside_band[1] < 1e-3
    alone = predict_response(drive * [[0.0], [1.0]], FRF, band=BAND, **NONE)
    np.testing.assert_allclose(found.response, alone.response, atol=0.02)


def test_the_uncertainty_is_what_models_drawn_from_it_scatter_by():
    # Independent errors from line to line, of a covariance that couples the drives.
    drive = noise_in(5.0, 40.0)
    covariance = np.broadcast_to(np.array([[1.0, 0.6j], [-0.6j, 0.8]]), (257, 2, 2)) * 1e-3
    residual = np.tile([1.0, 4.0], (257, 1))
    found = predict_response(drive, FRF, band=BAND, residual_psd=residual, row_covariance=covariance)
    factor, generator = np.linalg.cholesky(covariance), np.random.default_rng(3)
    errors = []
    for _ in range(40):
        normal = generator.standard_normal((2, 257, 2, 2)) / np.sqrt(2.0)
        change = np.matmul(normal[0] + 1j * normal[1], factor.transpose(0, 2, 1)) * np.sqrt(residual)[:, :, None]
        errors.append(predict_response(drive, FRF + change, band=BAND, **NONE).response - respond(drive))
    scatter = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    # Between lines a spline through independent errors scatters less than they do: by the squares of its weights.
    weights = CubicSpline(np.arange(41.0), np.eye(41))(np.linspace(20.0, 21.0, 200, endpoint=False))
    smoothed = np.sqrt(np.mean(np.sum(weights**2, axis=1)))
    assert 0.85 < smoothed < 0.95
    np.testing.assert_allclose(scatter / found.uncertainty_rms, smoothed, rtol=0.06)


def test_a_drive_of_other_channels_is_refused():
    with pytest.raises(ValueError, match="3 channels; the model has 2 drives"):
        predict_response(np.zeros((3, 100)), FRF, band=BAND, **NONE)


def test_the_level_advised_is_that_of_the_drive_that_made_the_target():
    drive = noise_in(5.0, 40.0) * [[0.01], [0.002]]
    advice = advise_levels(respond(drive) + 100.0, FRF, band=BAND, room=np.array([1.0, 1.0]))
    np.testing.assert_allclose(advice.rms, np.sqrt(np.mean(drive**2, axis=1)), rtol=0.01)
    np.testing.assert_allclose(advice.response_ratio, 1.0, rtol=1e-6)
    assert not advice.limited.any()


@pytest.mark.parametrize("drift", [10.0, 30.0])
def test_a_target_that_drifts_needs_no_larger_drive(drift):
    drive = noise_in(5.0, 40.0) * [[0.01], [0.002]]
    target = respond(drive)
    ramp = drift * np.std(target, axis=1, keepdims=True) * np.linspace(-3.0, 1.0, target.shape[1])
    advice = advise_levels(target + ramp, FRF, band=BAND, room=np.array([1.0, 1.0]))
    np.testing.assert_allclose(advice.rms, np.sqrt(np.mean(drive**2, axis=1)), rtol=0.01)


def test_the_units_of_the_drives_do_not_change_the_level_advised():
    target, units = respond(noise_in(5.0, 40.0)), np.array([1e-12, 1e6])
    one = advise_levels(target, FRF, band=BAND, room=np.full(2, 100.0))
    other = advise_levels(target, FRF / units, band=BAND, room=100.0 * units)
    np.testing.assert_allclose(other.wanted_rms / units, one.wanted_rms, rtol=1e-9)
    np.testing.assert_allclose(other.response_ratio, one.response_ratio, rtol=1e-9)


def test_limits_hold_the_level_back_with_room_for_the_peaks():
    drive = noise_in(5.0, 40.0) * [[0.01], [0.002]]
    advice = advise_levels(respond(drive), FRF, band=BAND, room=np.array([0.02, 1.0]), crest_factor=4.0)
    assert advice.rms[0] == 0.005 == advice.largest_rms[0] < advice.wanted_rms[0]
    assert advice.limited.tolist() == [True, False]
    assert advice.response_ratio[0] < 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": np.ones((3, 500))}, "3 channels; the model has 2 responses"),
        ({"target": np.ones((2, 500))}, "does not move from 1 to 60 Hz"),
        ({"target": np.full((2, 500), 3600.1)}, "does not move from 1 to 60 Hz"),
        ({"crest_factor": 0.9}, "crest factor is 0.9"),
        ({"room": np.array([0.0, 1.0])}, "every one of 2 drives needs some"),
    ],
)
def test_impossible_advice_is_refused(changes, message):
    target = changes.pop("target", noise_in(5.0, 40.0))
    with pytest.raises(ValueError, match=message):
        advise_levels(target, FRF, band=BAND, **{"room": np.ones(2), **changes})


def test_the_difference_of_two_models_is_told_from_chance():
    shape = (257, 2, 2)
    second = FRF.copy()
    second[100:110, 0] *= 1.3
    lines = BAND.lines
    difference = model_difference(
        FRF,
        second,
        drive_psd=np.ones((257, 2)),
        first_variance=np.full(shape, 0.0),
        second_variance=np.full(shape, 0.01),
        lines=lines,
    )
    np.testing.assert_allclose(difference.relative[100:110, 0], 0.3)
    assert not difference.relative[~lines].any()
    size = np.sum(np.abs(FRF[50, 1]) ** 2)
    assert difference.by_chance[50, 1] == pytest.approx(np.sqrt(0.02 / size))
    first, other = difference_sentences(difference, frequency=FREQUENCY, responses=("left_vertical", "right_vertical"))
    assert "at most by 30 % at" in first
    assert "in left vertical" in first
    assert "by 0 % in right vertical" in other


def test_the_damage_of_an_experiment_follows_the_power_of_its_levels():
    damage = channel_damage(respond(noise_in(5.0, 40.0)))
    psd = BAND.lines[:, None] * np.array([1.0, 4.0])
    tripled = damage_at_levels(damage, FRF, drive_psd=psd, levels=[3.0, 3.0])
    np.testing.assert_allclose(tripled, channel_damage(3.0 * respond(noise_in(5.0, 40.0))))
    # Each response follows the drives that move it, and rests where none of them plays.
    apart = np.eye(2) * BAND.lines[:, None, None]
    single = damage_at_levels(damage, apart, drive_psd=psd, levels=[2.0, 0.0])
    np.testing.assert_allclose(single, [[2.0**3, 2.0**5, 2.0**8], [0.0, 0.0, 0.0]] * damage)
