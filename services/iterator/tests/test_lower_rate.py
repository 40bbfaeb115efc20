"""Lines of a band at a lower sample rate, against the samples of tones."""

import numpy as np
import pytest

from iterator.band import LowerRate, control_band

RATE = 512.0
SAMPLES = 4_000


@pytest.fixture
def lower():
    band = control_band(lowest=1.0, highest=40.0, sample_rate=RATE)
    return LowerRate(band.transform(SAMPLES), oversampling=2.0), band


def test_a_tone_is_the_same_at_both_rates(lower):
    lower, band = lower
    length = band.transform_samples(SAMPLES)
    line = round(20.0 * length / RATE)
    tone = np.sin(2 * np.pi * line / length * np.arange(length) + 0.3)

    at_lower_rate = lower.record(tone[None])[0]

    assert lower.samples < length / 2
    expected = np.sin(2 * np.pi * line / lower.samples * np.arange(lower.samples) + 0.3)
    np.testing.assert_allclose(at_lower_rate, expected, atol=1e-12)


def test_lines_of_a_band_are_kept_in_time_and_back(lower):
    lower, band = lower
    transform = band.transform(SAMPLES)
    rng = np.random.default_rng(1)
    lines = rng.standard_normal((2, transform.frequency.size)) + 1j * rng.standard_normal((2, transform.frequency.size))

    in_time = lower.in_time(lines)

    np.testing.assert_allclose(lower.in_lines(in_time), lines, atol=1e-10)
    whole = np.empty((2, SAMPLES))
    for row, out in zip(lines, whole, strict=True):
        transform.samples(row, out=out)
    # The rates have one sample in common here and there.
    ratio = band.transform_samples(SAMPLES) / lower.samples
    common = [at for at in range(lower.samples) if (at * ratio).is_integer() and at * ratio < SAMPLES]
    assert len(common) > 10
    np.testing.assert_allclose(in_time[:, common], whole[:, [int(at * ratio) for at in common]], atol=1e-10)


def test_the_rate_is_never_above_that_of_the_record():
    band = control_band(lowest=1.0, highest=220.0, sample_rate=RATE)

    lower = LowerRate(band.transform(SAMPLES), oversampling=4.0)

    assert lower.share == 1.0
    assert lower.samples == band.transform_samples(SAMPLES)


def test_a_mask_is_true_where_a_sample_of_the_record_is(lower):
    lower, _ = lower
    where = np.zeros(SAMPLES, dtype=bool)
    where[1000:1200] = True

    mask = lower.mask(where)

    at = np.flatnonzero(mask) / lower.share
    assert mask.size == lower.samples
    assert 1000 - 1 / lower.share <= at.min()
    assert at.max() < 1200
    assert np.all(np.diff(np.flatnonzero(mask)) == 1)
