"""The lines of a band and records from them, beside the one long transform that they stand for."""

import numpy as np
import pytest

from iterator.band.banded_transform import BandedTransform

RATE = 1000.0


@pytest.mark.parametrize("length", [240, 250, 243, 2000, 2001, 4 * 1875])
@pytest.mark.parametrize("highest", [60.0, 124.9, 125.0, 126.0, 250.0, 251.0, 500.0])
@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
def test_both_ways_are_those_of_one_long_transform(length, highest, share):
    random = np.random.default_rng(length)
    samples = random.standard_normal(max(1, round(share * length)))
    transform = BandedTransform(length, sample_rate=RATE, lowest=5.0, highest=highest)
    whole = np.fft.rfft(samples, length)
    frequency = np.fft.rfftfreq(length, 1.0 / RATE)
    inside = (frequency >= 5.0) & (frequency < highest)
    np.testing.assert_allclose(transform.frequency, frequency[inside], rtol=1e-12)

    weight = random.uniform(0.0, 1.0, transform.frequency.size)
    lines = np.empty(transform.frequency.size, dtype=complex)
    transform.lines(samples, weight=weight, out=lines)
    np.testing.assert_allclose(lines, weight * whole[inside], atol=1e-12 * np.abs(whole).max())

    expected = np.zeros(whole.size, dtype=complex)
    expected[inside] = lines
    made = np.empty(samples.size)
    transform.samples(lines, out=made)
    np.testing.assert_allclose(made, np.fft.irfft(expected, length)[: samples.size], atol=1e-13 * np.abs(whole).max())


def test_a_channel_has_nothing_of_the_one_before():
    transform = BandedTransform(400, sample_rate=RATE, lowest=5.0, highest=100.0)
    random = np.random.default_rng(1)
    first, second = random.standard_normal((2, 170))
    weight = np.ones(transform.frequency.size)
    lines, alone = np.empty((2, transform.frequency.size), dtype=complex)
    for channel in (first, second):
        transform.lines(channel, weight=weight, out=lines)
    BandedTransform(400, sample_rate=RATE, lowest=5.0, highest=100.0).lines(second, weight=weight, out=alone)
    np.testing.assert_array_equal(lines, alone)
    made, by_itself = np.empty((2, 170))
    transform.samples(lines, out=np.empty(170))
    transform.samples(2.0 * lines, out=made)
    BandedTransform(400, sample_rate=RATE, lowest=5.0, highest=100.0).samples(2.0 * alone, out=by_itself)
    np.testing.assert_array_equal(made, by_itself)
