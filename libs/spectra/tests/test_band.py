import numpy as np
import pytest

import spectra

RATE = 1000.0


def test_the_mask_is_zero_outside_one_inside_and_smooth_between():
    frequency = np.linspace(0.0, 60.0, 6001)
    mask = spectra.band_mask(frequency, 2.0, 50.0, edge=1.0)
    assert not np.any(mask[(frequency <= 2.0) | (frequency >= 50.0)])
    assert np.all(mask[(frequency >= 3.0) & (frequency <= 49.0)] == 1.0)
    assert np.max(np.abs(np.diff(mask))) < 0.025
    rising = mask[(frequency >= 2.0) & (frequency <= 3.0)]
    np.testing.assert_allclose(rising + rising[::-1], 1.0, atol=1e-12)


def test_a_band_from_zero_keeps_the_mean():
    assert spectra.band_mask([0.0], 0.0, 50.0, edge=1.0)[0] == 1.0


def test_limiting_keeps_an_inner_tone_where_it_is_and_removes_an_outer_one():
    time = np.arange(20_001) / RATE
    envelope = np.hanning(time.size) ** 2
    inner, outer = np.sin(2 * np.pi * 20.0 * time) * envelope, np.sin(2 * np.pi * 80.0 * time) * envelope
    limited = spectra.limit_band(np.stack([inner, inner + outer]), sample_rate=RATE, lowest=1.0, highest=50.0, edge=1.0)
    np.testing.assert_allclose(limited, np.stack([inner, inner]), atol=1e-7)


def test_the_end_of_a_record_does_not_return_at_its_start():
    record = np.zeros((1, 60_001))
    record[0, -1] = 1.0
    band = {"sample_rate": RATE, "lowest": 0.8, "highest": 45.0, "edge": 0.4}
    limited = spectra.limit_band(record, **band)
    long_padding = spectra.limit_band(np.hstack([record, np.zeros((1, 200_000))]), **band)[:, :60_001]
    assert np.max(np.abs(limited - long_padding)) < 1e-6 * np.max(np.abs(limited))


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ({"lowest": 5.0, "highest": 2.0, "edge": 0.1}, "rising"),
        ({"lowest": 1.0, "highest": 600.0, "edge": 0.1}, "at or below 500"),
        ({"lowest": 1.0, "highest": 3.0, "edge": 1.5}, "at most half the band"),
        ({"lowest": 1.0, "highest": 3.0, "edge": 0.0}, "greater than 0"),
        ({"lowest": float("nan"), "highest": 3.0, "edge": 0.1}, "finite"),
    ],
)
def test_impossible_bands_are_refused(band, message):
    with pytest.raises(ValueError, match=message):
        spectra.limit_band(np.ones((1, 100)), sample_rate=RATE, **band)
