from itertools import pairwise

import numpy as np
import pytest

import spectra


def test_a_sine_rises_once_a_period_through_what_it_reaches():
    sine = np.sin(2.0 * np.pi * (np.arange(1000) + 0.5) / 100.0)
    counts = spectra.count_level_crossings(np.vstack([sine, 2.0 * sine]), [-1.5, -0.5, 0.3, 0.9, 1.5])
    np.testing.assert_array_equal(counts, [[0, 10, 10, 10, 0], [10, 10, 10, 10, 10]])


def test_counts_are_those_of_a_loop_over_samples_and_levels():
    rng = np.random.default_rng(0)
    signal = rng.integers(-5, 6, (2, 400)).astype(float)
    levels = np.array([-4.0, -2.5, 0.0, 1.0, 5.0])
    expected = [[sum(before < level <= after for before, after in pairwise(row)) for level in levels] for row in signal]
    np.testing.assert_array_equal(spectra.count_level_crossings(signal, levels), expected)


@pytest.mark.parametrize("levels", [[1.0, 1.0], [2.0, 1.0], [np.nan], [[1.0], [2.0]]])
def test_levels_that_do_not_rise_are_refused(levels):
    with pytest.raises(ValueError, match="rising values"):
        spectra.count_level_crossings(np.zeros((1, 5)), levels)
