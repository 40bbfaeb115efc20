import numpy as np
import pytest

from identifier import estimate_h1, frf_variance, relative_magnitude_variance

RATE = 100.0
WELCH = {"block_samples": 128, "overlap": 0.5, "sample_rate": RATE, "lowest": 1.0, "highest": 49.0}


@pytest.mark.parametrize("coherence", [0.5, 0.8, 0.95])
def test_eq_11_predicts_the_empirical_variance(coherence):
    generator = np.random.default_rng(17)
    noise = np.sqrt(1.0 / coherence - 1.0)
    runs, samples, magnitudes, averages = 250, 25_000, [], 0.0
    for _ in range(runs):
        drive = generator.standard_normal((1, samples))
        response = drive + noise * generator.standard_normal((1, samples))
        estimate = estimate_h1(drive, response, **WELCH)
        band = estimate.condition_number > 0
        magnitudes.append(np.abs(estimate.frf[band, 0, 0]))
        averages = estimate.independent_averages
    empirical = np.mean(np.var(magnitudes, axis=0, ddof=1))
    predicted = relative_magnitude_variance(coherence, averages)
    assert 0.95 <= empirical / predicted <= 1.05


def test_the_variance_of_a_matrix_follows_from_residual_and_drives():
    generator = np.random.default_rng(23)
    true = np.array([[1.0, -0.5], [0.3, 2.0], [0.0, 1.0]])
    mixing = np.array([[1.0, 0.0], [0.6, 0.8]])
    frfs, predicted = [], []
    for _ in range(150):
        drive = mixing @ generator.standard_normal((2, 12_000))
        response = true @ drive + np.array([[0.5], [1.0], [2.0]]) * generator.standard_normal((3, 12_000))
        estimate = estimate_h1(drive, response, **WELCH)
        band = estimate.condition_number > 0
        frfs.append(estimate.frf[band])
        predicted.append(frf_variance(estimate)[band])
        assert not np.any(frf_variance(estimate)[~band])
    empirical = np.mean(np.var(frfs, axis=0, ddof=1), axis=0)
    np.testing.assert_allclose(empirical / np.mean(predicted, axis=(0, 1)), 1.0, atol=0.08)


def test_the_variance_holds_for_many_drives_and_few_averages():
    # Six drives fitted through some fifteen averages leave nine degrees of freedom: bias would be 1.6.
    generator = np.random.default_rng(29)
    frfs, predicted = [], []
    for _ in range(200):
        drive = generator.standard_normal((6, 1100))
        response = drive[:2] + 0.5 * generator.standard_normal((2, 1100))
        estimate = estimate_h1(drive, response, **WELCH)
        band = estimate.condition_number > 0
        frfs.append(estimate.frf[band])
        predicted.append(frf_variance(estimate)[band])
    assert 10.0 < estimate.independent_averages < 20.0
    empirical = np.mean(np.var(frfs, axis=0, ddof=1))
    assert empirical / np.mean(predicted) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("coherence", "averages"), [(0.0, 10.0), (1.1, 10.0), (0.5, 0.0), (np.nan, 1.0)])
def test_impossible_values_are_refused(coherence, averages):
    with pytest.raises(ValueError, match="must"):
        relative_magnitude_variance(coherence, averages)
