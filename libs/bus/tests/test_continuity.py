"""Continuity: compared with a plain set of the numbers received."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

import duralab_bus


def numbers(ranges):
    return [number for entry in ranges for number in entry]


@given(st.lists(st.integers(0, 40), max_size=60), st.integers(0, 50))
def test_tracker_knows_what_a_set_knows(seqs, count):
    tracker, received = duralab_bus.Continuity(), set()
    for seq in seqs:
        known = received | set(range(max(received, default=-1) + 1))
        found = tracker.accept(seq)
        # What is new is exactly what was jumped over by this message.
        assert numbers(found) == sorted(set(range(seq)) - known)
        received.add(seq)
    assert tracker.received == len(received)
    assert tracker.next_seq == max(received, default=-1) + 1
    assert tracker.contiguous == next(n for n in range(50) if n not in received)
    assert numbers(tracker.missing(count)) == sorted(set(range(count)) - received)
    assert all(entry and entry.step == 1 for entry in tracker.missing(count))
    for number in range(50):
        assert (number in tracker) == (number in received)


@given(st.permutations(range(30)))
def test_any_order_of_a_whole_stream_ends_whole(order):
    tracker = duralab_bus.Continuity()
    for seq in order:
        tracker.accept(seq)
    assert tracker.missing(30) == []
    assert tracker.contiguous == tracker.received == 30


def test_gap_is_reported_once_and_filled():
    tracker = duralab_bus.Continuity()
    assert tracker.accept(0) == []
    assert tracker.accept(5) == [range(1, 5)]
    assert tracker.accept(3) == []
    assert tracker.missing(8) == [range(1, 3), range(4, 5), range(6, 8)]


def test_negative_number_is_refused():
    with pytest.raises(ValueError, match="-1 is negative"):
        duralab_bus.Continuity().accept(-1)


@given(st.lists(st.integers(0, 40), max_size=20), st.integers(0, 40), st.integers(0, 20), st.integers(0, 60))
def test_filling_a_range_is_accepting_all_of_it(seqs, start, length, seq):
    whole, one_by_one = duralab_bus.Continuity(), duralab_bus.Continuity()
    for number in seqs:
        whole.accept(number)
        one_by_one.accept(number)
    whole.fill(range(start, start + length))
    for number in range(start, start + length):
        one_by_one.accept(number)
    if length:
        assert whole.missing(70) == one_by_one.missing(70)
    assert whole.first_missing(seq) == next(number for number in range(seq, 200) if number not in whole)
