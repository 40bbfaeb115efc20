import numpy as np
import pytest

import duralab_spectra


def test_metrics_of_a_response_at_half_level():
    target = np.random.default_rng(0).standard_normal((3, 500))
    np.testing.assert_allclose(duralab_spectra.relative_rms_error(target, 0.5 * target), 0.5, rtol=1e-14)
    np.testing.assert_allclose(duralab_spectra.rms_response(target, 0.5 * target), 0.5, rtol=1e-14)
    np.testing.assert_allclose(duralab_spectra.peak_ratio(target, -0.5 * target), 0.5, rtol=1e-14)


def test_the_overall_error_weighs_channels_by_their_own_target():
    target = np.array([[1.0, -1.0], [1e6, -1e6]])
    response = target * np.array([[0.0], [1.0]])
    assert duralab_spectra.overall_relative_rms_error(target, response) == pytest.approx(np.sqrt(0.5))


def test_a_silent_target_channel_is_refused_by_its_number():
    target = np.ones((3, 10))
    target[1] = 0.0
    with pytest.raises(ValueError, match="channel 1 is zero throughout"):
        duralab_spectra.relative_rms_error(target, target)


def test_records_of_different_length_are_not_compared():
    with pytest.raises(ValueError, match="must be equal to be compared"):
        duralab_spectra.rms_response(np.ones((1, 3)), np.ones((1, 4)))


def test_the_crest_factor_of_a_sine_is_the_root_of_two_and_of_a_square_wave_one():
    sine = np.sin(2.0 * np.pi * np.arange(1000) / 40.0)
    np.testing.assert_allclose(
        duralab_spectra.crest_factor(np.vstack([sine, np.sign(sine + 0.5)])), [np.sqrt(2.0), 1.0]
    )


def test_a_channel_at_rest_has_no_crest_factor():
    with pytest.raises(ValueError, match="Channel 1 is zero throughout"):
        duralab_spectra.crest_factor(np.array([[1.0], [0.0]]))
