import subprocess
import sys
from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest
import rainflow
from hypothesis import given, settings
from hypothesis import strategies as st
from pylife.stress.rainflow import FourPointDetector, FullRecorder

from duralab_loads import channel_damage, count_load_cycles, damage_ratio, pseudo_damage


def by_range(cycles):
    total = defaultdict(float)
    for value, count in zip(cycles.ranges, cycles.counts, strict=True):
        total[round(float(value), 9)] += float(count)
    return dict(total)


def test_the_standards_example_is_counted_as_printed():
    # ASTM E1049-85, figure 6.
    counted = by_range(count_load_cycles([-2, 1, -3, 5, -1, 3, -4, 4, -2]))
    assert counted == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}


@settings(max_examples=150)
@given(st.lists(st.integers(-6, 6), min_size=2, max_size=60))
def test_plateaus_and_ties_are_counted_as_the_peer_counts_them(values):
    expected = {range_: count for range_, count in rainflow.count_cycles(values) if range_ > 0}
    if all(step >= 0 for step in np.diff(values)) or all(step <= 0 for step in np.diff(values)):
        # The peer sees nothing in a signal that never turns; the standard's residual is half a cycle.
        expected = {float(np.ptp(values)): 0.5} if np.ptp(values) else {}
    assert by_range(count_load_cycles(np.array(values, dtype=float))) == expected


@settings(max_examples=150)
@given(st.lists(st.integers(-6, 6), min_size=1, max_size=60))
def test_closed_cycles_have_the_turning_points_of_pylife(values):
    signal = np.array(values, dtype=float)
    recorder = FullRecorder()
    detector = FourPointDetector(recorder).process(signal)
    cycles = count_load_cycles(signal)
    closed = cycles.counts == 1.0
    assert cycles.starts[closed].tolist() == list(recorder.index_from)
    assert cycles.ends[closed].tolist() == list(recorder.index_to)
    places = [int(place) for place in detector.residual_index]
    half = list(zip(cycles.starts[~closed].tolist(), cycles.ends[~closed].tolist(), strict=True))
    assert half == [(begin, end) for begin, end in pairwise(places) if signal[begin] != signal[end]]
    np.testing.assert_array_equal(cycles.ranges, np.abs(signal[cycles.ends] - signal[cycles.starts]))


@pytest.mark.parametrize("samples", [2048, 20001])
@pytest.mark.parametrize("exponent", [3.0, 5.0, 8.0])
def test_damage_of_noise_is_that_of_the_peer(samples, exponent):
    signal = np.cumsum(np.random.default_rng(3).standard_normal(samples)) * 1e3
    expected = sum(count * range_**exponent for range_, count in rainflow.count_cycles(signal))
    assert pseudo_damage(count_load_cycles(signal), exponent) == pytest.approx(expected, rel=1e-10)


def test_damage_grows_with_the_power_of_the_level_and_the_largest_range_is_peak_to_peak():
    signal = np.random.default_rng(4).standard_normal(5000)
    cycles = count_load_cycles(signal)
    assert cycles.ranges.max() == pytest.approx(np.ptp(signal))
    assert np.all(np.abs(cycles.means) <= np.abs(signal).max())
    for exponent in (3.0, 5.0, 8.0):
        doubled = pseudo_damage(count_load_cycles(-2.0 * signal + 7.0), exponent)
        assert doubled == pytest.approx(2.0**exponent * pseudo_damage(cycles, exponent), rel=1e-9)


def test_a_sine_of_ten_periods_does_ten_cycles_of_damage():
    # From 0 to 0 the first and the last quarter are half cycles of half the range each.
    signal = 3.0 * np.sin(2.0 * np.pi * np.arange(1001) / 100.0)
    assert by_range(count_load_cycles(signal))[6.0] == pytest.approx(9.5)


def test_a_signal_at_rest_has_no_cycles():
    assert count_load_cycles(np.full(10, 3.0)).ranges.size == 0
    assert pseudo_damage(count_load_cycles([1.0]), 5.0) == 0.0


def test_the_damage_ratio_is_the_power_of_the_level_per_channel():
    target = np.random.default_rng(5).standard_normal((2, 3000)) * np.array([[1e5], [1e-3]])
    ratio = damage_ratio(target, target * np.array([[0.9], [1.1]]))
    np.testing.assert_allclose(ratio, np.array([[0.9], [1.1]]) ** np.array([[3.0, 5.0, 8.0]]), rtol=1e-9)


@pytest.mark.parametrize(
    ("target", "response", "sentence"),
    [
        (np.ones((1, 5)), np.zeros((1, 5)), "channel 0 does not move"),
        (np.eye(2), np.ones((1, 2)), "both need as many"),
        (np.eye(2), np.full((2, 2), np.nan), "must be finite"),
    ],
)
def test_a_ratio_that_is_undefined_is_refused(target, response, sentence):
    with pytest.raises(ValueError, match=sentence):
        damage_ratio(target, response)


def test_every_cycle_lies_between_the_turning_points_it_names():
    signal = np.random.default_rng(6).standard_normal(3000)
    cycles = count_load_cycles(signal)
    np.testing.assert_array_equal(np.abs(signal[cycles.ends] - signal[cycles.starts]), cycles.ranges)
    # A plateau, and an end that is a turning point.
    cycles = count_load_cycles([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 2.0, -1.0, -1.0])
    assert sorted(zip(cycles.ranges, cycles.counts, strict=True)) == [(1.0, 1.0), (2.0, 0.5), (3.0, 0.5)]


def test_a_slope_of_zero_is_refused():
    with pytest.raises(ValueError, match="greater than 0"):
        pseudo_damage(count_load_cycles([0.0, 1.0]), 0.0)


def test_the_damage_of_a_channel_is_that_of_its_cycles_whatever_its_static_part():
    # Ranges 4 and 4 as one cycle (two halves of 4 each), 2 as one: 4^k + 2^k, and nothing for a channel at rest.
    zigzag = np.array([0.0, 4.0, 1.0, 3.0, 0.0])
    damage = channel_damage(np.stack([zigzag, zigzag + 1e3, np.full(5, 7.0)]))
    expected = [4.0**k + 2.0**k for k in (3.0, 5.0, 8.0)]
    np.testing.assert_allclose(damage, [expected, expected, [0.0, 0.0, 0.0]])


def test_counting_imports_no_pandas():
    program = "import sys; from duralab_loads import count_load_cycles; print(count_load_cycles([0, 1, 0, 2]).counts)"
    program += "; print('pandas' in sys.modules); import pylife.stress.rainflow"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"
