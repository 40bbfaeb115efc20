"""The order of a stream: compared with plain sets and lists, whatever comes when."""

from hypothesis import given
from hypothesis import strategies as st

from duralab_bus.streams.order import MOST_HELD, MOST_LOST_RANGES, StreamOrder

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


@given(st.lists(st.tuples(st.integers(0, COUNT - 1), st.booleans()), max_size=80))
def test_refused_messages_are_lost_and_what_goes_on_keeps_its_order(arriving):
    order, delivered, told, first = StreamOrder(), [], [], {}
    for seq, readable in arriving:
        first.setdefault(seq, readable)
        if readable:
            delivered += order.accept(seq, seq)
        else:
            tell, ready = order.refuse(seq)
            delivered += ready
            told += [seq] if tell and not first[seq] else []
        lost = {number for gap in order.proof().lost for number in gap}
        assert lost == {number for number, came_readable in first.items() if not came_readable}
    whole = next(number for number in range(COUNT + 1) if number not in first)
    assert delivered == [seq for seq in range(whole) if first[seq]]
    # Each once; a refused one in the place of one that could be read is another's, and told whenever it comes.
    assert sorted(told) == sorted(lost_of(first))
    assert order.lost == len(told)
    assert order.proof().received == len(delivered)
    order.expect(COUNT)
    assert set(order.wanted(COUNT)).isdisjoint(first)
    for seq in range(COUNT):
        order.accept(seq, seq)
    assert order.proof().missing == ()
    assert order.proof().complete == (not told)


def lost_of(first):
    """Return the numbers that came refused before they came otherwise."""
    return [seq for seq, readable in first.items() if not readable]


@given(st.sets(st.integers(0, COUNT - 1)), st.lists(st.integers(0, COUNT - 1), max_size=60))
def test_what_was_refused_is_marked_with_what_is_stored(refused, stored):
    order = StreamOrder()
    for seq in sorted(refused):
        order.refuse(seq)
    for seq in stored:
        order.store(seq)
    known = {*stored, *refused}
    assert order.mark == next(number for number in range(COUNT + 1) if number not in known)


def test_what_is_refused_behind_a_gap_is_bounded_and_taken_when_the_gap_is_closed():
    order = StreamOrder()
    # Every other one, so that each makes a gap of its own.
    told = [seq for seq in range(1, 6 * MOST_HELD, 2) if order.refuse(seq)[0]]
    assert told == list(range(1, 2 * MOST_HELD, 2))
    assert len(order.proof().lost) == MOST_LOST_RANGES
    assert order.lost == MOST_HELD
    assert not order.refuse(2 * MOST_HELD + 1)[0]
    delivered = []
    for seq in range(0, 2 * MOST_HELD + 1, 2):
        delivered += order.accept(seq, seq)
    assert delivered == list(range(0, 2 * MOST_HELD + 1, 2))
    assert order.refuse(2 * MOST_HELD + 1) == (True, [])
    assert order.mark == 0


def test_refused_number_that_cannot_be_neither_jumps_the_stream_nor_outlives_its_end():
    order, delivered = StreamOrder(), []
    for seq in (2**63, 2**64 - 1):
        assert order.refuse(seq) == (True, [])
    for seq in (0, 2, 1, 3):
        delivered += order.accept(seq, seq)
        order.store(seq)
    assert delivered == [0, 1, 2, 3]
    assert order.mark == 4
    assert order.gap
    order.learn(first=0, next=4, marked=0, done=True)
    assert order.proof().complete


def test_what_is_only_held_back_is_no_progress():
    order = StreamOrder()
    order.accept(0, 0)
    before = order.progress
    order.accept(2, 2)
    began = order.progress
    assert began != before
    order.accept(3, 3)
    assert order.progress == began
    for change in (lambda: order.refuse(5), lambda: order.accept(1, 1), lambda: order.accept(7, 7)):
        before = order.progress
        change()
        assert order.progress != before
