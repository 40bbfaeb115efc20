from itertools import pairwise

import numpy as np
import pytest

from duralab_loads import count_exceeded_ranges, count_level_crossings, count_load_cycles, share_of_time_at_level


def test_a_sine_rises_through_every_level_within_it_once_a_period():
    time = np.arange(10_000) / 1000.0
    sine = 3.0 * np.sin(2 * np.pi * 2.0 * time + 0.1)
    assert count_level_crossings(sine, [-3.1, -2.0, 0.01, 2.0, 3.1]).tolist() == [0, 20, 20, 20, 0]


def test_crossings_are_those_of_a_count_step_by_step():
    generator = np.random.default_rng(5)
    # Whole numbers, so that many samples lie on a level.
    signal = np.cumsum(generator.integers(-2, 3, size=500)).astype(float)
    levels = np.arange(signal.min() - 1, signal.max() + 2)
    counted = [sum(a < level <= b for a, b in pairwise(signal)) for level in levels]
    assert count_level_crossings(signal, levels).tolist() == counted


def test_time_at_level_of_a_triangle_is_even_and_adds_up():
    triangle = np.abs((np.arange(40_000) / 1000.0) % 2.0 - 1.0)
    shares = share_of_time_at_level(triangle, np.linspace(0.0, 1.0, 11))
    np.testing.assert_allclose(shares, 0.1, atol=1e-3)
    assert shares.sum() == pytest.approx(1.0)
    with pytest.raises(ValueError, match="do not rise"):
        share_of_time_at_level(triangle, [0.0, 0.0, 1.0])


@pytest.mark.parametrize("shape", [(2, 100), (1, 100), (100, 1), ()])
@pytest.mark.parametrize(
    "count",
    [
        count_load_cycles,
        lambda signal: count_level_crossings(signal, [0.5]),
        lambda signal: share_of_time_at_level(signal, [0.0, 1.0]),
    ],
    ids=["cycles", "crossings", "time"],
)
def test_only_one_channel_is_counted_at_a_time(count, shape):
    with pytest.raises(ValueError, match=r"a signal has shape \(samples,\): give one channel at a time"):
        count(np.full(shape, 0.25))


def test_exceeded_ranges_are_those_of_the_standards_example():
    # ASTM E1049-85, figure 6: ranges 3, 4, 4, 6, 8, 8, 9 as 0.5, 0.5, 1, 0.5, 0.5 + 0.5, 0.5.
    cycles = count_load_cycles([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
    assert count_exceeded_ranges(cycles, [1, 3, 3.5, 4, 5, 6.5, 8, 8.5, 9, 10]).tolist() == [
        4.0,
        4.0,
        3.5,
        3.5,
        2.0,
        1.5,
        1.5,
        0.5,
        0.5,
        0.0,
    ]
