import numpy as np
import pytest

import duralab_spectra


def test_the_mask_is_zero_outside_one_inside_and_smooth_between():
    frequency = np.linspace(0.0, 60.0, 6001)
    mask = duralab_spectra.band_mask(frequency, 2.0, 50.0, edge=1.0)
    assert not np.any(mask[(frequency <= 2.0) | (frequency >= 50.0)])
    assert np.all(mask[(frequency >= 3.0) & (frequency <= 49.0)] == 1.0)
    assert np.max(np.abs(np.diff(mask))) < 0.025
    rising = mask[(frequency >= 2.0) & (frequency <= 3.0)]
    np.testing.assert_allclose(rising + rising[::-1], 1.0, atol=1e-12)


def test_a_band_from_zero_keeps_the_mean():
    assert duralab_spectra.band_mask([0.0], 0.0, 50.0, edge=1.0)[0] == 1.0


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ({"lowest": 5.0, "highest": 2.0, "edge": 0.1}, "rising"),
        ({"lowest": 1.0, "highest": 3.0, "edge": 1.5}, "at most half the band"),
        ({"lowest": 1.0, "highest": 3.0, "edge": -0.1}, "0 or more"),
        ({"lowest": float("nan"), "highest": 3.0, "edge": 0.1}, "finite"),
    ],
)
def test_impossible_bands_are_refused(band, message):
    with pytest.raises(ValueError, match=message):
        duralab_spectra.band_mask([2.0], **band)
