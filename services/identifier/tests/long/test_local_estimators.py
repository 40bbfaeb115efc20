import numpy as np
import pytest
from known_plants import PLANT, error, lightly_damped, noise_layout, periodic_experiment, respond

from duralab_settings import EstimatorKind
from identifier import EstimatorOptions, estimate

BLOCK = 2048


def noise(channels, samples, seed=0):
    return np.random.default_rng(seed).standard_normal((channels, samples))


def at(result, frequency):
    """Position among the valid lines."""
    return int(np.argmin(np.abs(result.frequency[result.valid] - frequency)))


def estimates(plant, kinds, *, samples=240_000, **options):
    drive = noise(2, samples)
    layout = noise_layout(samples, block=BLOCK)
    response = respond(drive, plant)
    return [estimate(kind, drive, response, layout, EstimatorOptions(**options)) for kind in kinds]


def test_the_local_polynomial_method_removes_the_leakage_bias_of_h1_at_a_resonance():
    plant = lightly_damped(0.02)
    h1, local = estimates(plant, [EstimatorKind.H1, EstimatorKind.LOCAL_POLYNOMIAL], half_width=8)
    resonance = at(h1, 20.0)
    assert error(h1, plant)[resonance] > 10.0 * error(local, plant)[resonance]


def test_the_local_rational_method_is_exact_for_a_single_resonance_where_h1_is_not():
    plant = lightly_damped(0.003)
    h1, local = estimates(plant, [EstimatorKind.H1, EstimatorKind.LOCAL_RATIONAL])
    assert np.max(error(h1, plant)) > 0.3
    assert np.max(error(local, plant)) < 1e-7
    np.testing.assert_allclose(local.coherence[local.valid], 1.0, atol=1e-9)


def test_near_sharp_resonances_with_noise_the_local_rational_method_is_tens_of_times_better_than_h1():
    plant = lightly_damped(0.003)
    drive = noise(2, 240_000)
    response = respond(drive, plant)
    response += 0.002 * np.std(response, axis=1, keepdims=True) * noise(2, 240_000, seed=1)
    layout = noise_layout(240_000, block=BLOCK)
    h1, local = (estimate(kind, drive, response, layout) for kind in (EstimatorKind.H1, EstimatorKind.LOCAL_RATIONAL))
    near = [at(h1, frequency) for frequency in (20.0, 37.0)]
    assert np.max(error(h1, plant)[near]) > 20.0 * np.max(error(local, plant)[near])


@pytest.mark.parametrize("kind", [EstimatorKind.LOCAL_POLYNOMIAL, EstimatorKind.LOCAL_RATIONAL])
def test_three_responses_of_two_drives_in_noise(kind):
    drive = noise(2, 240_000)
    response = respond(drive) + 0.02 * noise(3, 240_000, seed=1)
    result = estimate(kind, drive, response, noise_layout(240_000, block=BLOCK))
    assert np.median(error(result)) < 0.01
    # White noise of variance v has the one-sided density 2 v / rate.
    assert np.median(result.residual_psd[result.valid]) == pytest.approx(
        2.0 * 0.02**2 / 1000.0, rel=0.05 if kind is EstimatorKind.LOCAL_POLYNOMIAL else 0.15
    )


def test_the_variance_of_the_local_polynomial_method_is_what_its_averages_say():
    gain = np.array([[1.0, -0.5], [0.3, 2.0]])
    frfs, predicted = [], []
    layout = noise_layout(40_000, block=512, lowest=10.0)
    for seed in range(40):
        drive = noise(2, 40_000, seed=2 * seed)
        response = gain @ drive + np.array([[0.5], [1.0]]) * noise(2, 40_000, seed=2 * seed + 1)
        result = estimate(EstimatorKind.LOCAL_POLYNOMIAL, drive, response, layout)
        lines = result.valid
        inverse = np.einsum("fjj->fj", np.linalg.inv(result.s_uu[lines])).real
        frfs.append(result.frf[lines])
        predicted.append(
            result.residual_psd[lines][:, :, None] * inverse[:, None, :] / result.averages[lines][:, None, None]
        )
    np.testing.assert_allclose(np.mean(frfs, axis=(0, 1)), gain, atol=0.02)
    empirical = np.mean(np.var(frfs, axis=0, ddof=1), axis=0)
    np.testing.assert_allclose(empirical / np.mean(predicted, axis=(0, 1)), 1.0, atol=0.15)


@pytest.mark.parametrize("periods", [1, 2])
def test_a_transient_in_the_captures_is_removed(periods):
    plant = lightly_damped(0.02)
    # A delay block too short for the resonance, so that every capture begins with a transient.
    drive, layout = periodic_experiment(block=2048, delay=1, periods=periods, experiments=6)
    response = respond(drive, plant)
    h1, polynomial, rational = (
        estimate(kind, drive, response, layout, EstimatorOptions(half_width=width))
        for kind, width in (
            (EstimatorKind.H1, None),
            (EstimatorKind.LOCAL_POLYNOMIAL, 4),
            (EstimatorKind.LOCAL_RATIONAL, 12),
        )
    )
    assert np.median(error(h1, plant)) > 1e-3
    # Away from the resonance, which is narrower than the neighbourhood, a polynomial is enough.
    assert np.median(error(polynomial, plant)) < 1e-6
    assert np.max(error(rational, plant)) < 1e-5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": -1}, "Orders -1"),
        ({"half_width": 3}, "equations for"),
        ({"half_width": 20_000}, "wider than the spectrum"),
        ({"half_width": 30, "segment_blocks": 0}, "0 blocks in a segment"),
    ],
)
def test_neighbourhoods_that_cannot_be_solved_are_refused(options, message):
    drive = noise(2, 20_000)
    options = {"segment_blocks": 1000} | options
    with pytest.raises(ValueError, match=message):
        estimate(
            EstimatorKind.LOCAL_POLYNOMIAL,
            drive,
            respond(drive, PLANT),
            noise_layout(20_000),
            EstimatorOptions(**options),
        )
