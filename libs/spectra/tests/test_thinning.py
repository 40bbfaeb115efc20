"""A thinned curve keeps every peak; compared with the extremes of each piece, taken one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from duralab_spectra import drawn_points, piece_extremes

curves = hnp.arrays(np.float64, st.integers(1, 300), elements=st.floats(-1e6, 1e6))


@given(values=curves, length=st.integers(1, 50))
def test_each_piece_gives_its_extremes(values, length):
    pieces = [values[first : first + length] for first in range(0, values.size, length)]
    expected = [(piece.min(), piece.max()) for piece in pieces]
    np.testing.assert_array_equal(values[piece_extremes(values, length)], expected)


@given(values=curves, length=st.integers(1, 50))
def test_drawn_points_keep_peaks_and_ends_in_order(values, length):
    kept = drawn_points(values, length)
    assert np.all(np.diff(kept) > 0)
    assert (kept[0], kept[-1]) == (0, values.size - 1)
    assert (values[kept].min(), values[kept].max()) == (values.min(), values.max())


def test_two_points_of_each_piece_are_left():
    assert drawn_points(np.random.default_rng(1).standard_normal(8000), 8).size <= 2 * 1000 + 2


@pytest.mark.parametrize("length", [1, 2, 100])
def test_nothing_is_left_out_where_nothing_can_be(length):
    assert drawn_points(np.arange(100.0), length).size == 100
