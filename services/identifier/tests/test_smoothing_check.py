"""A local method that smoothed a resonance says so."""

import numpy as np
import pytest
from known_plants import RATE, error, lightly_damped, respond
from short_experiments import WHITE, settings_of

from identifier.estimators import EstimatorKind, WarningCode, estimate
from identifier.excitation import design_experiment


def identified(damping, *, noise, kind=EstimatorKind.LOCAL_POLYNOMIAL):
    # After ten blocks of 2 s the slowest mode, 20 Hz with 0.2 % damping, has died out to one part in a hundred.
    settings = settings_of(
        drives=2, spectra=(WHITE, WHITE), levels=(1.0, 1.0), delay_blocks=10, capture_blocks=1, realisations=3,
        duration_seconds=160.0,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    plant = lightly_damped(damping)
    response = respond(experiment.drive, plant)
    level = noise * np.std(response, axis=1, keepdims=True)
    response += level * np.random.default_rng(3).standard_normal(response.shape)
    return estimate(kind, experiment.drive, response, experiment.layout), plant


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
