import numpy as np
import pytest

from iterator import control_band, energy_outside_band, report_playback, unreachable_segments

RATE = 200.0
BAND = control_band(2.0, 40.0, sample_rate=RATE)


def tones(*parts, samples=8000):
    """Tones of (frequency, amplitude) that swell and fade, so that nothing jumps at the ends."""
    time = np.arange(samples) / RATE
    return np.hanning(samples) * sum(amplitude * np.sin(2.0 * np.pi * f * time) for f, amplitude in parts)


def test_content_outside_the_band_is_told_as_a_share_of_energy():
    target = np.vstack([tones((0.5, 1.0), (10.0, 2.0), (70.0, 3.0)) + 500.0, tones((10.0, 1.0))])
    outside = energy_outside_band(target, BAND)
    np.testing.assert_allclose(outside.below, [1.0 / 14.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(outside.above, [9.0 / 14.0, 0.0], atol=1e-6)


def test_a_record_at_rest_has_nothing_outside():
    outside = energy_outside_band(np.full((1, 500), 3.0), BAND)
    np.testing.assert_array_equal([outside.below, outside.above], 0.0)


def test_in_band_does_not_see_what_lies_outside_and_overall_does():
    target = tones((10.0, 1.0))[None] + 20.0
    response = 0.9 * tones((10.0, 1.0))[None] + tones((70.0, 0.5))[None] - 3.0
    report = report_playback(target, response, band=BAND, block_samples=512)
    np.testing.assert_allclose(report.in_band.relative_rms_error, 0.1, rtol=1e-5)
    np.testing.assert_allclose(report.in_band.damage_ratio, [0.9 ** np.array([3.0, 5.0, 8.0])], rtol=1e-4)
    np.testing.assert_allclose(report.overall.relative_rms_error, np.hypot(0.1, 0.5), rtol=1e-5)


def test_the_overlay_shows_level_and_coherence_line_by_line():
    rng = np.random.default_rng(2)
    target = rng.standard_normal((1, 20000))
    noise = rng.standard_normal((1, 20000))
    response = 0.5 * target + 0.5 * noise
    overlay = report_playback(target, response, band=BAND, block_samples=256).spectra
    inner = slice(5, -5)
    np.testing.assert_allclose(overlay.target[inner].mean(), 2.0 / RATE, rtol=0.03)
    np.testing.assert_allclose((overlay.response / overlay.target)[inner].mean(), 0.5, rtol=0.05)
    np.testing.assert_allclose(overlay.coherence[inner].mean(), 0.5, atol=0.03)
    np.testing.assert_allclose(overlay.error[inner].mean(), 0.5 * 2.0 / RATE, rtol=0.05)


def test_a_response_that_is_too_small_rises_through_fewer_outer_levels():
    target = tones((10.0, 1.0))[None]
    report = report_playback(target, 0.5 * target, band=BAND, block_samples=512, levels=15)
    assert report.levels.shape == report.target_crossings.shape == (1, 15)
    assert report.response_crossings[0, 0] == report.response_crossings[0, -1] == 0
    assert report.target_crossings[0, -1] > 0
    assert abs(int(report.response_crossings[0, 7]) - int(report.target_crossings[0, 7])) <= 1


def test_an_error_where_a_drive_was_held_is_unreachable_and_one_elsewhere_is_not():
    target = np.random.default_rng(3).standard_normal((2, 8000))
    response = 0.95 * target
    response[0, 2000:2600] = 0.2 * target[0, 2000:2600]
    response[1, 6000:6600] = 0.2 * target[1, 6000:6600]
    saturated = np.zeros((3, 8000), dtype=bool)
    saturated[2, 2000:2600:7] = True
    (found,) = unreachable_segments(target, response, saturated=saturated, sample_rate=RATE)
    assert found.response == 0
    assert (found.segment.start, found.segment.end) == pytest.approx((10.0, 13.0), abs=0.6)
    assert found.relative_rms_error == pytest.approx(0.8, abs=0.12)


def test_a_held_drive_that_costs_no_error_is_not_flagged():
    target = np.random.default_rng(4).standard_normal((1, 4000))
    saturated = np.zeros((1, 4000), dtype=bool)
    assert unreachable_segments(target, 0.9 * target, saturated=saturated, sample_rate=RATE) == ()
    saturated[0, 1000:1100] = True
    assert unreachable_segments(target, 0.9 * target, saturated=saturated, sample_rate=RATE) == ()


def test_fewer_than_two_levels_are_refused():
    with pytest.raises(ValueError, match="2 or more"):
        report_playback(tones((10.0, 1.0))[None], tones((10.0, 1.0))[None], band=BAND, block_samples=64, levels=1)
