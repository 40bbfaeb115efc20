"""A local method that smoothed a resonance with a width that was given says so."""

import numpy as np
import pytest
from known_plants import RATE, error, lightly_damped, respond, true_frf
from short_experiments import WHITE, settings_of

from duralab_settings import EstimatorKind, ExcitationKind
from identifier.estimators import EstimatorOptions, WarningCode, estimate
from identifier.excitation import design_experiment

LOCAL = (EstimatorKind.LOCAL_POLYNOMIAL, EstimatorKind.LOCAL_RATIONAL)
AT_REST = (ExcitationKind.BURST_RANDOM, ExcitationKind.SWEPT_SINE)


def identified(damping, *, noise, kind=EstimatorKind.LOCAL_POLYNOMIAL):
    # After ten blocks of 2 s the slowest mode, 20 Hz with 0.2 % damping, has died out to one part in a hundred.
    settings = settings_of(
        drives=2, drive_spectra=(WHITE, WHITE), rms=(1.0, 1.0), delay_blocks=10, capture_blocks=1, realisations=3,
        duration=160.0,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    plant = lightly_damped(damping)
    response = respond(experiment.drive, plant)
    level = noise * np.std(response, axis=1, keepdims=True)
    response += level * np.random.default_rng(3).standard_normal(response.shape)
    options = EstimatorOptions(half_width=16)
    return estimate(kind, experiment.drive, response, experiment.layout, options), plant


def smoothed(result):
    return [warning for warning in result.warnings if warning.code is WarningCode.SMOOTHED]


def test_a_resonance_narrower_than_the_lines_is_named_with_the_size_of_the_error():
    result, plant = identified(0.002, noise=0.0)
    assert np.max(error(result, plant)) > 0.3
    assert [warning.channel for warning in smoothed(result)] == [0, 1]
    assert all(warning.size > 0.1 for warning in smoothed(result))


def test_the_warning_names_the_band_of_the_resonance_that_was_smoothed():
    result, _ = identified(0.002, noise=0.0)
    for warning, resonance in zip(smoothed(result), (20.0, 37.0), strict=True):
        lowest, highest = warning.band
        assert lowest <= resonance <= highest
        assert highest - lowest < 2.0
        assert f"between {lowest:.4g} and {highest:.4g} Hz" in warning.sentence


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_broad_resonances_in_noise_are_not_suspected(noise):
    result, _ = identified(0.6, noise=noise)
    assert smoothed(result) == []


def test_h1_has_nothing_to_smooth():
    result, _ = identified(0.002, noise=0.0, kind=EstimatorKind.H1)
    assert smoothed(result) == []


def played(kind, damping, *, estimator, noise=0.0, half_width=16, seconds=120.0, distort=None, **changes):
    settings = settings_of(
        drives=2, drive_spectra=(WHITE, WHITE), rms=(1.0, 1.0), kind=kind, duration=seconds, **changes
    )
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    plant = lightly_damped(damping)
    response = respond(experiment.drive, plant)
    if distort is not None:
        response = distort(response)
    level = noise * np.std(response, axis=1, keepdims=True)
    response += level * np.random.default_rng(3).standard_normal(response.shape)
    options = EstimatorOptions(half_width=half_width)
    return estimate(estimator, experiment.drive, response, experiment.layout, options), plant


def shares(result, plant):
    """Share of each response's RMS by which the FRF is wrong."""
    expected = true_frf(result.frequency[result.valid], plant)

    def power(frf):
        return np.einsum("fij,fjk,fik->i", frf, result.s_uu[result.valid], frf.conj()).real

    return np.sqrt(power(result.frf[result.valid] - expected) / power(expected))


@pytest.mark.parametrize("kind", [*AT_REST, ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.HADAMARD])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_neighbourhood_wider_than_the_resonances_is_named_with_the_error(kind, noise):
    # Half-power bandwidths of 2 and 3.7 Hz within 16 Hz.
    result, plant = played(kind, 0.05, estimator=EstimatorKind.LOCAL_POLYNOMIAL, noise=noise)
    true = shares(result, plant)
    assert np.all(true > 0.2)
    assert [warning.size for warning in smoothed(result)] == pytest.approx(true, rel=0.15)
    remedy = "take h1, longer blocks or a smaller local_half_width, at least 2."
    if kind is ExcitationKind.SWEPT_SINE:
        remedy = "take h1 or random_orthogonal."
    assert all(warning.sentence.endswith(remedy) for warning in smoothed(result))


@pytest.mark.parametrize("kind", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.ORTHOGONAL_DFT])
def test_a_single_realisation_without_degrees_of_freedom_is_judged_too(kind):
    result, plant = played(
        kind, 0.05, estimator=EstimatorKind.LOCAL_POLYNOMIAL, seconds=20.0, delay_blocks=2, realisations=1
    )
    assert result.independent_averages == 2
    assert [warning.size for warning in smoothed(result)] == pytest.approx(shares(result, plant), rel=0.15)


@pytest.mark.parametrize("estimator", LOCAL)
@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("kind", [ExcitationKind.BURST_RANDOM, ExcitationKind.PURE_RANDOM])
def test_broad_resonances_are_not_suspected_whatever_the_excitation(kind, noise, estimator):
    result, _ = played(kind, 0.6, estimator=estimator, noise=noise)
    assert smoothed(result) == []


def test_in_noise_a_resonance_narrower_than_the_neighbourhood_is_named_with_the_error():
    result, plant = played(ExcitationKind.PURE_RANDOM, 0.005, estimator=EstimatorKind.LOCAL_POLYNOMIAL, noise=0.01)
    true = shares(result, plant)
    assert np.all(true > 0.05)
    found = smoothed(result)
    assert [warning.channel for warning in found] == [0, 1]
    for warning in found:
        assert 0.5 < warning.size / true[warning.channel] < 2.0
        assert "the same method over fewer lines shows" in warning.sentence


@pytest.mark.parametrize("kind", [ExcitationKind.HADAMARD, ExcitationKind.ORTHOGONAL_DFT])
def test_distortion_that_all_captures_share_is_not_taken_for_a_bias(kind):
    def cube(response):
        return response + 0.5 * response**3 / np.var(response, axis=1, keepdims=True)

    result, _ = played(
        kind, 0.6, estimator=EstimatorKind.LOCAL_POLYNOMIAL, seconds=30.0, realisations=1, repeats=2, distort=cube
    )
    assert smoothed(result) == []


def test_the_bias_at_a_resonance_is_that_of_the_fourth_derivative():
    damping, half_width = 0.1, 6
    settings = settings_of(
        drives=2, drive_spectra=(WHITE, WHITE), rms=(1.0, 1.0), block_samples=8192, delay_blocks=1, realisations=4,
        duration=240.0,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    plant = lightly_damped(damping)
    result = estimate(
        EstimatorKind.LOCAL_POLYNOMIAL,
        experiment.drive,
        respond(experiment.drive, plant),
        experiment.layout,
        EstimatorOptions(half_width=half_width),
    )
    # H = 1 / (1 + j x) with x = (f - f0) / (zeta f0) has the fourth derivative 24 / (1 + j x)^5; docs/theory.
    # The next term of the series takes a sixth off at this width.
    x = (result.frequency - 20.0) / (damping * 20.0)
    lines = np.abs(x) < 1.5
    expected = true_frf(result.frequency[lines], plant)[:, 0]
    # Of 2 w + 1 lines instead of a continuum, w^4 is the product of w - 1 to w + 2.
    reach = np.prod(half_width + np.arange(-1.0, 3.0)) ** 0.25 * RATE / 8192
    bias = -(3.0 / 35.0) * (reach / (damping * 20.0)) ** 4 * expected / (1.0 + 1j * x[lines, None]) ** 4
    found = result.frf[lines, 0] - expected
    assert np.vdot(bias, found).real / np.vdot(bias, bias).real == pytest.approx(1.0, abs=0.25)
    assert np.linalg.norm(found - bias) < 0.4 * np.linalg.norm(bias)


@pytest.mark.parametrize(("half_width", "warned"), [(5, True), (16, False)])
def test_hardly_more_equations_than_unknowns_is_warned_of_with_the_width_to_take(half_width, warned):
    # 30 s are one segment: 11 lines give 8 equations for the 6 unknowns of two drives.
    result, _ = played(
        ExcitationKind.PURE_RANDOM, 0.6, estimator=EstimatorKind.LOCAL_POLYNOMIAL, half_width=half_width, seconds=30.0
    )
    found = [warning for warning in result.warnings if warning.code is WarningCode.FEW_AVERAGES]
    assert len(found) == warned
    assert all("gives hardly more equations than the 6 unknowns" in warning.sentence for warning in found)
