import numpy as np
import pytest
from known_plants import noise_layout

from duralab_settings import EstimatorKind, ExcitationKind
from identifier import EstimatorOptions, element_variance, estimate, relative_magnitude_variance, row_covariance
from identifier.excitation import ExperimentSettings, design_experiment, white
from identifier.uncertainty import unexplained_shares, unexplained_verdicts

RATE, BLOCK = 1000.0, 128


def estimated(drive, response):
    layout = noise_layout(drive.shape[1], block=BLOCK, lowest=10.0, highest=490.0)
    return estimate(EstimatorKind.H1, drive, response, layout)


def variance_of(found):
    return element_variance(found.residual_psd, row_covariance(found.s_uu, averages=found.averages))


@pytest.mark.parametrize("coherence", [0.5, 0.8, 0.95])
def test_eq_11_predicts_the_empirical_variance(coherence):
    generator = np.random.default_rng(17)
    noise = np.sqrt(1.0 / coherence - 1.0)
    runs, samples, magnitudes, averages = 250, 25_000, [], 0.0
    for _ in range(runs):
        drive = generator.standard_normal((1, samples))
        response = drive + noise * generator.standard_normal((1, samples))
        found = estimated(drive, response)
        band = found.valid
        magnitudes.append(np.abs(found.frf[band, 0, 0]))
        averages = found.independent_averages
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
        found = estimated(drive, response)
        band = found.valid
        frfs.append(found.frf[band])
        predicted.append(variance_of(found)[band])
        assert not np.any(variance_of(found)[~band])
    empirical = np.mean(np.var(frfs, axis=0, ddof=1), axis=0)
    ratio = empirical / np.mean(predicted, axis=(0, 1))
    np.testing.assert_allclose(ratio, 1.0, atol=0.08)
    assert 0.95 <= np.mean(ratio) <= 1.05


def test_the_variance_holds_for_many_drives_and_few_averages():
    # Six drives fitted through some fifteen averages leave nine degrees of freedom: bias would be 1.6.
    generator = np.random.default_rng(29)
    frfs, predicted = [], []
    for _ in range(200):
        drive = generator.standard_normal((6, 1100))
        response = drive[:2] + 0.5 * generator.standard_normal((2, 1100))
        found = estimated(drive, response)
        band = found.valid
        frfs.append(found.frf[band])
        predicted.append(variance_of(found)[band])
    assert 10.0 < found.independent_averages < 20.0
    empirical = np.mean(np.var(frfs, axis=0, ddof=1))
    assert empirical / np.mean(predicted) == pytest.approx(1.0, abs=0.1)


def test_the_covariance_of_a_row_holds_between_the_drives():
    generator = np.random.default_rng(31)
    mixing = np.array([[1.0, 0.0], [0.6, 0.8]])
    errors, predicted = [], []
    for _ in range(150):
        drive = mixing @ generator.standard_normal((2, 6000))
        # A delay between the drives makes their covariance complex.
        drive[1] = np.roll(drive[1], 3)
        response = drive[:1] - 2.0 * drive[1:] + 0.7 * generator.standard_normal((1, 6000))
        found = estimated(drive, response)
        errors.append((found.frf - [[1.0, -2.0]])[found.valid, 0])
        covariance = row_covariance(found.s_uu, averages=found.averages)
        predicted.append((covariance * found.residual_psd[:, :1, None])[found.valid])
    empirical = np.einsum("rfj,rfk->fjk", errors, np.conj(errors)) / len(errors)
    expected = np.mean(predicted, axis=0)
    # The delay turns the phase of the off-diagonal from line to line; turned back it is one number.
    turn = np.exp(1j * np.angle(expected[:, 0, 1]))
    ratio = np.mean(empirical[:, 0, 1] / turn) / np.mean(np.abs(expected[:, 0, 1]))
    assert abs(ratio - 1.0) < 0.05
    assert np.mean(np.abs(expected[:, 0, 1])) > 0.3 * np.mean(expected[:, 0, 0].real)


@pytest.mark.parametrize("kind", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.PSEUDO_RANDOM])
def test_the_variance_holds_for_periodic_experiments(kind):
    settings = ExperimentSettings(
        kind=kind,
        drive_spectra=(white(lowest_frequency=10.0, highest_frequency=490.0),) * 3,
        rms=(1.0, 2.0, 0.5),
        duration=13.9,
        block_samples=256,
        fade=0.0,
        seed=4,
        delay_blocks=1,
        capture_blocks=2,
    )
    experiment = design_experiment(settings, drives=3, sample_rate=RATE)
    drive, generator = experiment.drive, np.random.default_rng(5)
    true = np.array([[1.0, 0.5, -1.0], [0.3, 2.0, 0.0]])
    clean = true @ drive
    errors, predicted, coherence = [], [], 1.0
    for _ in range(60):
        response = clean + np.array([[1.0], [3.0]]) * generator.standard_normal(clean.shape)
        found = estimate(EstimatorKind.H1, drive, response, experiment.layout)
        errors.append((found.frf - true)[found.valid])
        predicted.append(variance_of(found)[found.valid])
        coherence = np.mean(found.coherence[found.valid])
    assert coherence > 0.5
    empirical = np.mean(np.abs(errors) ** 2, axis=0)
    assert 0.95 <= np.mean(empirical / np.mean(predicted, axis=0)) <= 1.05


@pytest.mark.parametrize(("coherence", "averages"), [(0.0, 10.0), (1.1, 10.0), (0.5, 0.0), (np.nan, 1.0)])
def test_impossible_values_are_refused(coherence, averages):
    with pytest.raises(ValueError, match="must"):
        relative_magnitude_variance(coherence, averages)


@pytest.mark.parametrize(
    ("kind", "options", "tolerance"),
    [
        (EstimatorKind.H1, None, 0.02),
        (EstimatorKind.H2, None, 0.02),
        (EstimatorKind.HV, None, 0.02),
        (EstimatorKind.LOCAL_POLYNOMIAL, EstimatorOptions(half_width=16), 0.02),
        # Its denominator bends towards the noise, for which one degree of freedom is a little too few.
        (EstimatorKind.LOCAL_RATIONAL, EstimatorOptions(half_width=16, order=1), 0.06),
    ],
)
@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_the_share_unexplained_of_few_averages_is_that_of_the_noise(kind, options, tolerance, noise):
    # Six drives and twelve averages: half of the noise looks as if the drives explained it.
    runs, generator, squares = 40, np.random.default_rng(8), []
    for _ in range(runs):
        drive = generator.standard_normal((6, 12 * 256))
        response = drive + noise * generator.standard_normal((6, 12 * 256))
        layout = noise_layout(drive.shape[1], block=256, lowest=30.0, highest=470.0)
        found = estimate(kind, drive, response, layout, options)
        shares = unexplained_shares(
            found.frequency, lines=found.valid, residual_psd=found.unexplained_psd, response_psd=found.response_psd
        )
        assert np.all(shares.worst <= 1.0)
        squares.append(shares.over_band**2)
    assert np.mean(squares) == pytest.approx(noise**2 / (1.0 + noise**2), rel=tolerance)


def test_a_response_of_noise_alone_is_wholly_unexplained_and_not_more():
    generator = np.random.default_rng(9)
    drive = generator.standard_normal((6, 12 * 256))
    layout = noise_layout(drive.shape[1], block=256, lowest=30.0, highest=470.0)
    found = estimate(EstimatorKind.H1, drive, generator.standard_normal((6, 12 * 256)), layout)
    shares = unexplained_shares(
        found.frequency, lines=found.valid, residual_psd=found.unexplained_psd, response_psd=found.response_psd
    )
    assert np.all((shares.over_band > 0.97) & (shares.over_band <= 1.0))
    assert np.all(shares.worst <= 1.0)
    assert unexplained_verdicts(shares, responses=["a"])[0].startswith("Unexplained 100 % of the response at ")
