"""Thinning keeps every peak, whatever pieces a record comes in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from operator_page.envelope import MOST_BUCKETS, Envelope, rounded


@given(st.integers(1, 9 * MOST_BUCKETS), st.lists(st.integers(1, 4000), max_size=8), st.integers(0, 99))
def test_each_bucket_has_the_extremes_of_its_samples_however_they_came(samples, cuts, seed):
    record = np.random.default_rng(seed).standard_normal((2, samples))
    envelope = Envelope(2)
    first = 0
    for cut in [*cuts, samples]:
        envelope.put(first, record[:, first : first + cut])
        first = min(samples, first + cut)
    low, high = envelope.part(0)
    length = envelope.bucket_samples
    wanted = [record[:, at : at + length] for at in range(0, samples, length)]
    np.testing.assert_array_equal(low, np.stack([piece.min(axis=1) for piece in wanted], axis=1))
    np.testing.assert_array_equal(high, np.stack([piece.max(axis=1) for piece in wanted], axis=1))
    assert low.shape[1] <= MOST_BUCKETS


def test_what_was_lost_stays_empty_and_a_record_of_known_length_is_not_halved():
    envelope = Envelope(1, samples=10 * MOST_BUCKETS)
    envelope.put(50, np.ones((1, 10)))
    assert envelope.bucket_samples == 10
    low, _ = envelope.part(0)
    assert rounded(low) == [[None, None, None, None, None, 1.0]]


def test_numbers_keep_four_digits():
    assert rounded(np.array([[123456.0, -0.000123456, np.nan]])) == [[pytest.approx(123500.0), -0.0001235, None]]
