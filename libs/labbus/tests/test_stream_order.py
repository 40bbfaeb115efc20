"""The order of a stream: compared with plain sets and lists, whatever comes when."""

from hypothesis import given
from hypothesis import strategies as st

from labbus._stream_order import MOST_HELD, StreamOrder

COUNT = 30


@given(st.lists(st.integers(0, COUNT - 1), max_size=80))
def test_whatever_arrives_goes_on_once_and_in_order(seqs):
    order, delivered = StreamOrder(), []
    for seq in seqs:
        delivered += order.accept(seq, seq)
        assert delivered == list(range(len(delivered)))
    whole = next(number for number in range(COUNT + 1) if number not in seqs)
    assert delivered == list(range(whole))
    proof = order.proof()
    assert proof.received == whole
    assert proof.next == max(seqs, default=-1) + 1
    assert proof.missing == ((range(whole, proof.next),) if whole < proof.next else ())
    assert not proof.complete


@given(st.lists(st.integers(0, COUNT - 1), max_size=40), st.integers(1, 5))
def test_what_is_asked_for_is_exactly_what_is_not_here(seqs, most):
    order = StreamOrder()
    for seq in seqs:
        order.accept(seq, seq)
    order.expect(COUNT)
    absent = sorted(set(range(COUNT)) - set(seqs))
    asked, start = [], 0
    while wanted := order.wanted(most, start=start):
        assert len(wanted) <= most
        asked += wanted
        start = wanted.stop
    assert asked == absent
    for seq in asked:
        order.accept(seq, seq)
    assert order.proof().complete


@given(st.sets(st.integers(0, COUNT - 1)), st.integers(0, COUNT), st.integers(0, COUNT))
def test_lost_is_what_its_publisher_lets_go_of_after_the_receiver_began(seqs, marked, first):
    order, delivered = StreamOrder(), []
    order.learn(first=0, next=0, marked=marked, done=False)
    for seq in sorted(seqs):
        delivered += order.accept(seq, seq)
    order.learn(first=first, next=COUNT, marked=first, done=True)
    delivered += order.advance()
    assert delivered == sorted(delivered)
    assert set(delivered) <= seqs
    # All below `first` is settled one way or the other.
    assert {seq for seq in seqs if seq < first} <= set(delivered)
    lost = {seq for gap in order.proof().lost for seq in gap}
    assert lost == {seq for seq in range(first) if seq >= marked} - seqs


def test_who_had_the_first_message_was_there_before_anything_was_stored():
    order = StreamOrder()
    for seq in (0, 2):
        order.accept(seq, seq)
    order.learn(first=3, next=4, marked=3, done=False)
    assert order.proof().lost == (range(1, 2),)


@given(st.sets(st.integers(0, COUNT - 1), min_size=1))
def test_gap_given_up_is_passed_over_and_filled_late(seqs):
    order, delivered = StreamOrder(), []
    for seq in sorted(seqs):
        delivered += order.accept(seq, seq)
    while order.blocked:
        order.skip()
        delivered += order.advance()
    assert delivered == sorted(seqs)
    for seq in range(COUNT):
        delivered += order.accept(seq, seq)
    assert sorted(delivered) == list(range(COUNT))


@given(st.lists(st.integers(0, COUNT - 1), max_size=60), st.integers(0, COUNT))
def test_mark_is_what_is_stored_without_a_hole(stored, first):
    order = StreamOrder()
    order.learn(first=first, next=COUNT, marked=first, done=False)
    for seq in stored:
        order.store(seq)
    known = {*stored, *range(first)}
    assert order.mark == next(number for number in range(COUNT + 1) if number not in known)


def test_what_is_held_back_is_bounded():
    order = StreamOrder()
    for seq in range(1, 3 * MOST_HELD):
        assert order.accept(seq, seq) == []
    assert order.accept(0, 0) == list(range(MOST_HELD + 1))
    assert order.wanted(1000) == range(MOST_HELD + 1, MOST_HELD + 1001)


def test_long_stream_that_others_stored_costs_nothing():
    order = StreamOrder()
    order.learn(first=10**12, next=10**12, marked=10**12, done=True)
    assert order.advance() == []
    assert order.proof().complete
    assert order.mark == 10**12


def test_number_that_cannot_be_is_no_part_of_a_stream_that_has_ended():
    order = StreamOrder()
    for seq in (0, 1, 2**64 - 1):
        order.accept(seq, seq)
    assert order.proof().received == 2
    assert order.gap
    order.learn(first=0, next=2, marked=0, done=True)
    assert order.proof().complete
    assert not order.gap
