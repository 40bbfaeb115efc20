import numpy as np
import pytest

from identifier.uncertainty import predict_convergence, spectral_radius

FREQUENCY = np.linspace(1.0, 40.0, 40)
GENERATOR = np.random.default_rng(2)
FRF = GENERATOR.standard_normal((40, 3, 3)) + 1j * GENERATOR.standard_normal((40, 3, 3)) + 4.0 * np.eye(3)
TALL = np.concatenate([FRF, GENERATOR.standard_normal((40, 1, 3))], axis=1)
CERTAIN = np.zeros((40, 3))
DRIVES = np.broadcast_to(np.eye(3, dtype=complex), (40, 3, 3))


@pytest.mark.parametrize(("frf", "responses"), [(FRF, 3), (TALL, 4)])
def test_an_exact_model_leaves_one_minus_the_gain(frf, responses):
    np.testing.assert_allclose(spectral_radius(frf, model=frf, gain=np.full(responses, 0.3)), 0.7, atol=1e-12)


def test_it_is_the_matrix_of_eq_6():
    rig = FRF * (1.0 + 0.3 * GENERATOR.standard_normal(FRF.shape))
    gain = np.diag([0.3, 0.5, 0.9])
    delta = np.linalg.inv(rig) - np.linalg.inv(FRF)
    step = np.eye(3) - np.linalg.inv(np.eye(3) + FRF @ delta) @ gain
    expected = np.max(np.abs(np.linalg.eigvals(step)), axis=1)
    np.testing.assert_allclose(spectral_radius(rig, model=FRF, gain=np.diag(gain)), expected, rtol=1e-10)


def test_an_iteration_shrinks_by_the_radius():
    rig, gain = FRF[5] @ np.diag([1.2, 0.8, 1.1]), np.full(3, 0.5)
    radius = spectral_radius(np.stack([rig, rig]), model=FRF[[5, 5]], gain=gain)[0]
    error = GENERATOR.standard_normal(3) + 0j
    inverse = np.linalg.inv(FRF[5])
    sizes = []
    for _ in range(60):
        error = error - rig @ inverse @ (gain * error)
        sizes.append(np.linalg.norm(error))
    assert (sizes[-1] / sizes[-21]) ** (1 / 20) == pytest.approx(radius, rel=0.01)


def test_a_sign_error_diverges_and_is_said():
    rig = FRF * np.array([1.0, 1.0, -1.0])
    assert np.all(spectral_radius(rig, model=FRF, gain=np.full(3, 0.5)) >= 1.5 - 1e-9)
    found = predict_convergence(
        FREQUENCY,
        FRF,
        gain=np.full(3, 0.5),
        residual_psd=CERTAIN,
        row_covariance=DRIVES,
        response_rms=np.ones(3),
        rig=rig,
    )
    assert found.converging_share == 0.0
    assert found.sentence.startswith("It will diverge at ")
    assert "grows by 1.5" in found.sentence


def test_a_certain_model_has_no_spread_and_falls_in_every_iteration():
    found = predict_convergence(
        FREQUENCY,
        TALL,
        gain=np.full(4, 0.6),
        residual_psd=np.zeros((40, 4)),
        row_covariance=DRIVES,
        response_rms=np.array([1.0, 10.0, 3.0, 0.2]),
    )
    np.testing.assert_allclose(found.spectral_radius_95, 0.4, atol=1e-9)
    np.testing.assert_allclose(found.largest_singular_value, 0.4, atol=1e-9)
    assert found.converging_share == 1.0
    assert found.sentence.startswith("It converges: in the long run the error falls by the factor 0.4")


def test_uncertainty_widens_the_confidence_as_much_as_it_should():
    # One drive, one response, h = 1: the radius is |1 - q (1 + d)| with d complex Gaussian of variance s.
    variance, gain = 0.04, 0.5
    shape = (2000, 1, 1)
    found = predict_convergence(
        np.arange(2000.0),
        np.ones(shape, dtype=complex),
        gain=[gain],
        residual_psd=np.full((2000, 1), variance),
        row_covariance=np.ones(shape, dtype=complex),
        response_rms=[1.0],
    )
    draws = np.random.default_rng(0).standard_normal((2, 400_000)) * np.sqrt(variance / 2.0)
    expected = np.quantile(np.abs(1.0 - gain * (1.0 + draws[0] + 1j * draws[1])), 0.95)
    assert np.mean(found.spectral_radius_95) == pytest.approx(expected, rel=0.01)
    larger = predict_convergence(
        FREQUENCY,
        FRF,
        gain=np.full(3, 0.5),
        residual_psd=np.full((40, 3), 9.0),
        row_covariance=DRIVES,
        response_rms=np.ones(3),
    )
    assert np.max(larger.spectral_radius_95) > 1.0
    assert 0.0 <= larger.converging_share < 0.5
    assert "may diverge" in larger.sentence


@pytest.mark.parametrize("units", [(1e-9, 1e6, 1.0), (1e-15, 1.0, 1e15)])
def test_the_units_of_the_drives_change_no_part_of_the_answer(units):
    # The same rig told in other units: u' = u * units.
    generator, unit = np.random.default_rng(4), np.array(units)
    mixed = generator.standard_normal((40, 3, 3)) + 1j * generator.standard_normal((40, 3, 3))
    covariance = mixed @ mixed.conj().transpose(0, 2, 1)
    frf, common = TALL, {"gain": np.full(4, 0.7), "residual_psd": np.full((40, 4), 0.02), "response_rms": np.ones(4)}
    rig = TALL * (1.0 + 0.1 * generator.standard_normal(TALL.shape))
    one = predict_convergence(FREQUENCY, frf, rig=rig, row_covariance=covariance, **common)
    assert np.max(one.spectral_radius_95) > np.max(one.spectral_radius) + 0.01
    other = predict_convergence(
        FREQUENCY,
        frf / unit,
        rig=rig / unit,
        row_covariance=covariance / (unit[:, None] * unit),
        **common,
    )
    np.testing.assert_allclose(other.spectral_radius, one.spectral_radius, rtol=1e-6)
    np.testing.assert_allclose(other.spectral_radius_95, one.spectral_radius_95, rtol=1e-6)
    np.testing.assert_allclose(other.largest_singular_value, one.largest_singular_value, rtol=1e-6)
    assert (other.converging_share, other.sentence) == (one.converging_share, one.sentence)


@pytest.mark.parametrize("gain", [[0.5, 0.5], [0.0, 0.5, 0.5], [0.5, 1.1, 0.5], [np.nan, 0.5, 0.5]])
def test_impossible_gains_are_refused(gain):
    with pytest.raises(ValueError, match="each of the 3 responses needs one above 0 to 1"):
        spectral_radius(FRF, model=FRF, gain=gain)
