import numpy as np
import pytest
from known_plants import PLANT, RATE, error, lightly_damped, noise_layout, periodic_experiment, respond, true_frf
from scipy import signal

from duralab_settings import EstimatorKind
from duralab_spectra import count_blocks, hann_periodic
from identifier import LARGEST_CONDITION, Estimation, EstimatorOptions, SpectralSums, estimate
from identifier.estimators.coherence import multiple_coherence, require_audible
from identifier.estimators.condition import unit_diagonal
from identifier.estimators.h2 import h2

SPECTRAL = [EstimatorKind.H1, EstimatorKind.H2, EstimatorKind.HV]
SQUARE = PLANT[:2]


def noise(channels, samples, seed=0):
    return np.random.default_rng(seed).standard_normal((channels, samples))


@pytest.mark.parametrize("periods", [1, 3])
def test_periodic_excitation_gives_the_frf_of_a_linear_plant_to_rounding(periods):
    drive, layout = periodic_experiment(periods=periods)
    result = estimate(EstimatorKind.H1, drive, respond(drive), layout)
    assert np.array_equal(result.valid, layout.excited)
    # Lines where the experiments happen to have like phases lose digits to their condition number.
    assert np.max(error(result) / result.condition_number[result.valid]) <= 1e-13
    assert np.median(error(result)) <= 1e-14
    assert result.blocks == 4 * periods
    assert result.independent_averages == 4
    np.testing.assert_allclose(result.coherence[result.valid], 1.0, atol=1e-11)


@pytest.mark.parametrize("kind", SPECTRAL)
def test_every_spectral_estimator_is_exact_without_noise_and_leakage(kind):
    drive, layout = periodic_experiment(experiments=6)
    # Total least squares loses the square root of the rounding of the spectra it decomposes.
    tolerance = 1e-9 if kind is EstimatorKind.H2 else 1e-11
    assert np.median(error(estimate(kind, drive, respond(drive, SQUARE), layout), SQUARE)) <= tolerance


def test_random_excitation_gives_the_frf_up_to_leakage():
    drive = noise(2, 120_000)
    result = estimate(EstimatorKind.H1, drive, respond(drive), noise_layout(120_000))
    assert np.median(error(result)) < 0.01
    assert np.all(result.coherence[result.valid] > 0.95)
    assert result.condition_number[result.valid].min() >= 1.0
    assert result.condition_number[result.valid].max() < 3.0


def test_a_delay_has_falling_phase():
    drive = noise(1, 60_000)
    result = estimate(EstimatorKind.H1, drive, np.roll(drive, 5, axis=1), noise_layout(60_000))
    expected = np.exp(-2j * np.pi * result.frequency[result.valid] * 5 / RATE)
    np.testing.assert_allclose(result.frf[result.valid, 0, 0], expected, atol=0.02)


def test_the_frf_equals_one_from_a_loop_of_scipy_csd():
    drive = noise(2, 20_000)
    response = respond(drive) + noise(3, 20_000, seed=1)
    drive, response = (x - x.mean(axis=1, keepdims=True) for x in (drive, response))

    def spectra(a, b):
        chosen = {"fs": RATE, "window": hann_periodic(1024), "noverlap": 512, "detrend": False}
        return np.asarray([[signal.csd(y, x, **chosen)[1] for y in b] for x in a]).transpose(2, 0, 1)

    result = estimate(EstimatorKind.H1, drive, response, noise_layout(20_000))
    lines = result.valid
    expected = spectra(response, drive)[lines] @ np.linalg.inv(spectra(drive, drive)[lines])
    assert np.max(np.abs(result.frf[lines] - expected)) <= 1e-12 * np.max(np.abs(expected))


def test_noise_on_the_responses_biases_h2_and_not_h1():
    drive = noise(2, 400_000)
    response = respond(drive, SQUARE)
    response += 1.0 * np.std(response, axis=1, keepdims=True) * noise(2, 400_000, seed=1)
    layout = noise_layout(400_000, lowest=5.0)
    h1, h2 = (estimate(kind, drive, response, layout) for kind in (EstimatorKind.H1, EstimatorKind.H2))
    assert np.median(error(h1, SQUARE)) < 0.1
    assert np.median(error(h2, SQUARE)) > 3.0 * np.median(error(h1, SQUARE))


def test_noise_on_the_drives_biases_h1_and_not_h2():
    drive = noise(2, 400_000)
    response = respond(drive, SQUARE)
    measured = drive + noise(2, 400_000, seed=1)
    layout = noise_layout(400_000, lowest=5.0)
    h1, h2 = (estimate(kind, measured, response, layout) for kind in (EstimatorKind.H1, EstimatorKind.H2))
    expected = true_frf(h1.frequency[h1.valid], SQUARE)
    # As much noise as drive halves H1.
    assert np.median(np.abs(h1.frf[h1.valid] / expected)) == pytest.approx(0.5, abs=0.02)
    assert np.median(error(h2, SQUARE)) < 0.15


def test_hv_lies_between_h1_and_h2_and_is_right_for_noise_in_proportion():
    drive = noise(1, 300_000)
    gain = 40.0
    measured, response = drive + 0.5 * noise(1, 300_000, seed=1), gain * (drive + 0.5 * noise(1, 300_000, seed=2))
    layout = noise_layout(300_000)
    h1, h2, hv = (estimate(kind, measured, response, layout) for kind in SPECTRAL)
    size = [np.abs(result.frf[result.valid, 0, 0]) for result in (h1, hv, h2)]
    assert np.all((size[0] < size[1]) & (size[1] < size[2]))
    np.testing.assert_allclose(size[1] ** 2, size[0] * size[2], rtol=1e-9)
    assert np.mean(size[1]) == pytest.approx(gain, rel=0.01)


def test_hv_is_right_where_every_channel_has_the_same_share_of_noise():
    drive = noise(2, 400_000)
    response = respond(drive)
    spectrum = estimate(EstimatorKind.H1, drive, response, noise_layout(400_000))
    assert spectrum.frf.shape[1:] == (3, 2)
    gains = np.array([[3.0, 3.0], [5.0, -5.0], [0.2, 0.2]])
    clean = gains @ drive
    share = 0.4
    measured = drive + share * noise(2, 400_000, seed=1)
    answered = clean + share * np.std(clean, axis=1, keepdims=True) * noise(3, 400_000, seed=2)
    h1, hv = (
        estimate(kind, measured, answered, noise_layout(400_000)) for kind in (EstimatorKind.H1, EstimatorKind.HV)
    )
    means = [np.mean(result.frf[result.valid], axis=0) for result in (h1, hv)]
    assert np.max(np.abs(means[0] / gains - 1.0)) > 0.1
    np.testing.assert_allclose(means[1], gains, rtol=0.02)


def test_h2_needs_as_many_responses_as_drives():
    drive = noise(2, 20_000)
    with pytest.raises(ValueError, match="3 responses and 2 drives"):
        estimate(EstimatorKind.H2, drive, respond(drive), noise_layout(20_000))


@pytest.mark.parametrize("kind", list(EstimatorKind))
def test_nothing_is_estimated_outside_the_band(kind):
    drive = noise(2, 30_000)
    result = estimate(kind, drive, respond(drive, SQUARE), noise_layout(30_000))
    outside = (result.frequency < 1.0) | (result.frequency > 100.0)
    assert outside.sum() > 300
    assert not np.any(result.valid[outside])
    for values in (result.frf, result.coherence, result.condition_number, result.residual_psd, result.averages):
        assert not np.any(values[outside])
        assert np.all(np.isfinite(values))


@pytest.mark.parametrize("size", [0.0, 0.1, 10.0, 1e6])
def test_the_coherence_stays_between_zero_and_one(size):
    drive = noise(2, 15_000)
    response = respond(drive)
    coherence = estimate(
        EstimatorKind.H1, drive, response + size * noise(3, 15_000, seed=1), noise_layout(15_000)
    ).coherence
    assert np.all((coherence >= 0.0) & (coherence <= 1.0))
    if size > 1e5:
        # Nothing but noise: what two drives explain of N independent averages by chance.
        assert np.mean(coherence[coherence > 0]) < 0.2


@pytest.mark.parametrize("kind", list(EstimatorKind))
def test_units_change_nothing_but_the_units_of_the_frf(kind):
    drive = noise(2, 30_000)
    response = respond(drive, SQUARE) + 0.1 * noise(2, 30_000, seed=1)
    of_drive, of_response = np.array([[1e-6], [1e5]]), np.array([[1e7], [1e-3]])
    plain = estimate(kind, drive, response, noise_layout(30_000))
    scaled = estimate(kind, of_drive * drive, of_response * response, noise_layout(30_000))
    np.testing.assert_allclose(scaled.condition_number, plain.condition_number, rtol=1e-9)
    np.testing.assert_allclose(scaled.coherence, plain.coherence, atol=1e-9)
    back = scaled.frf * of_drive[:, 0] / of_response
    np.testing.assert_allclose(back, plain.frf, atol=1e-8 * np.max(np.abs(plain.frf)))


@pytest.mark.parametrize("kind", list(EstimatorKind))
@pytest.mark.parametrize("piece", [777, 20_001])
def test_the_estimate_does_not_depend_on_how_the_record_is_cut(kind, piece):
    drive = noise(2, 60_000)
    response = respond(drive, lightly_damped(0.02)) + 0.1 * noise(2, 60_000, seed=1) + np.array([[50.0], [-3.0]])
    layout = noise_layout(60_000, fade=500)
    running = Estimation(kind, layout, drives=2, responses=2, options=EstimatorOptions())
    for start in range(0, 60_000, piece):
        running.add(drive[:, start : start + piece], response[:, start : start + piece])
    expected, result = estimate(kind, drive, response, layout), running.estimate()
    assert np.max(np.abs(result.frf - expected.frf)) <= 1e-9 * np.max(np.abs(expected.frf))
    assert result.blocks == expected.blocks == count_blocks(59_000, 1024, 0.5)


def test_a_static_force_does_not_reach_the_lowest_line():
    drive = noise(2, 60_000)
    response = respond(drive) + 0.1 * noise(3, 60_000, seed=1)
    layout = noise_layout(60_000, lowest=0.9, fade=500)
    plain, loaded = (
        estimate(EstimatorKind.H1, drive, response + load, layout) for load in (0.0, [[3600.0], [-150.0], [20.0]])
    )
    assert loaded.valid[1]
    np.testing.assert_allclose(loaded.frf, plain.frf, atol=1e-9 * np.max(np.abs(plain.frf)))
    np.testing.assert_allclose(loaded.coherence, plain.coherence, atol=1e-8)


@pytest.mark.parametrize("difference", [0.0, 1e-3])
def test_drives_that_are_copies_are_refused_although_the_coherence_is_high(difference):
    drive = noise(3, 60_000)
    drive[2] = drive[0] + difference * drive[2]
    response = respond(drive[:2])
    alone = estimate(EstimatorKind.H1, drive[:2], response, noise_layout(60_000))
    assert np.median(alone.coherence[alone.valid]) > 0.99
    for kind in (EstimatorKind.H1, EstimatorKind.HV, EstimatorKind.LOCAL_POLYNOMIAL):
        with pytest.raises(ValueError, match=rf"at most {LARGEST_CONDITION:g} is allowed; drives 0 and 2 are most"):
            estimate(kind, drive, response, noise_layout(60_000))


def test_rounding_does_not_make_a_coherence_more_than_one():
    s_yu = np.ones((3, 1, 1), dtype=complex)
    h1 = np.array([1.0, 1.0 + 4e-16, -1e-17]).reshape(3, 1, 1).astype(complex)
    np.testing.assert_array_equal(multiple_coherence(h1, s_yu, np.ones((3, 1)))[:, 0], [1.0, 1.0, 0.0])


def test_silent_channels_are_named_with_the_frequency():
    frequency = np.array([1.0, 2.5])
    silent = np.array([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]], dtype=complex)
    with pytest.raises(ValueError, match=r"Drive 1 is silent at 2.5 Hz"):
        unit_diagonal(silent, frequency)
    with pytest.raises(ValueError, match=r"Response 1 is silent at 2.5 Hz"):
        require_audible(np.einsum("fii->fi", silent).real, frequency)
    with pytest.raises(ValueError, match=r"Drive 0 moves no response at 1 Hz"):
        h2(np.broadcast_to(np.eye(2, dtype=complex), (2, 2, 2)), silent[::-1, ::-1] * [0.0, 1.0], frequency)


@pytest.mark.parametrize(("condition", "allowed"), [(0.7e6, True), (1.5e6, False)])
def test_h2_inverts_up_to_a_condition_number_of_a_million(condition, allowed):
    s_yu = np.array([[[1.0, 1.0], [1.0, 1.0 + 4.0 / condition]]], dtype=complex)
    s_yy = np.eye(2, dtype=complex)[None]
    if allowed:
        np.testing.assert_allclose(h2(s_yy, s_yu, np.ones(1)) @ s_yu.conj().transpose(0, 2, 1), s_yy, atol=1e-8)
        return
    with pytest.raises(ValueError, match=r"condition number is 1\.5e\+06, at most 1e\+06"):
        h2(s_yy, s_yu, np.ones(1))


def test_h2_of_responses_that_are_copies_is_refused():
    drive = noise(2, 60_000)
    response = respond(drive, SQUARE)
    with pytest.raises(ValueError, match=r"S_uy is singular at .* take H1 or Hv"):
        estimate(EstimatorKind.H2, drive, np.concatenate((response[:1], 2.0 * response[:1])), noise_layout(60_000))


def test_fewer_blocks_than_drives_are_refused():
    drive = noise(4, 1600)
    with pytest.raises(ValueError, match="singular"):
        estimate(EstimatorKind.H1, drive, respond(drive[:2]), noise_layout(1600))


def test_the_blocks_averaged_are_those_of_eq_10():
    layout = noise_layout(60_000, overlap=0.75)
    sums = SpectralSums(layout, drives=1, responses=1)
    sums.add(noise(1, 60_000), noise(1, 60_000))
    assert sums.averages().blocks == (60_000 - 1024) // 256 + 1
