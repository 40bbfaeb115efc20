"""A record at another rate is the same signal."""

import numpy as np
import pytest

from duralab_drive_files import resampled


@pytest.mark.parametrize(("rate", "new_rate"), [(2048.0, 1000.0), (1000.0, 2048.0), (1000.0, 1000.05)])
def test_a_tone_is_the_same_tone_at_another_rate(rate, new_rate):
    """Two rates whose places between samples recur, and a clock that drifts, whose places never do."""

    def tone(at):
        return np.sin(2.0 * np.pi * 37.0 * np.arange(round(4.0 * at)) / at + 0.3)[None, :]

    found = resampled(tone(rate), rate, new_rate)
    expected = tone(new_rate)[:, : found.shape[1]]
    inside = slice(round(0.2 * new_rate), -round(0.2 * new_rate))
    np.testing.assert_allclose(found[:, : expected.shape[1]][:, inside], expected[:, inside], atol=2e-4)
