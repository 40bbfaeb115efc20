import numpy as np

from iterator import control_band, energy_outside_band, judge_response

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


def test_what_lies_outside_the_band_is_not_judged():
    target = tones((10.0, 1.0))[None] + 20.0
    response = 0.9 * tones((10.0, 1.0))[None] + tones((70.0, 0.5))[None] - 3.0
    judged = judge_response(BAND.limit_target(target), BAND.limit_response(response))
    np.testing.assert_allclose(judged.relative_rms_error, 0.1, rtol=1e-5)
    np.testing.assert_allclose(judged.damage_ratio, [0.9 ** np.array([3.0, 5.0, 8.0])], rtol=1e-4)
