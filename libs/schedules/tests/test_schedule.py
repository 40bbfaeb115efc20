"""A schedule file, and the order of its repeats."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_schedules import MOST_REPEATS, Block, Event, KeepRule, Order, Schedule, ScheduleError, read_schedule
from duralab_settings import SettingsError

REPEATS = st.lists(st.integers(0, 40), min_size=1, max_size=6).filter(any)
FREE = [order for order in Order if order is not Order.NESTED]

TEXT = """
name: weeks
rig: front_axle
events:
  belgian: {drive: belgian/recording.mcap, repeats: 5}
  city: {drive: city-20261125-1, repeats: 2}
"""


def schedule(repeats, order, seed=0):
    events = {f"event_{number}": Event(drive="a.drv", repeats=count) for number, count in enumerate(repeats)}
    return Schedule(name="some", rig="rig", events=events, order=order, seed=seed)


def written(tmp_path, text):
    path = tmp_path / "weeks.yaml"
    path.write_text(text)
    return path


@given(repeats=REPEATS, order=st.sampled_from(FREE), seed=st.integers(0, 2**63 - 1))
def test_each_event_stands_exactly_as_often_as_asked(repeats, order, seed):
    sequence = schedule(repeats, order, seed).sequence()
    assert np.bincount(sequence, minlength=len(repeats)).tolist() == repeats
    assert sequence.shape == (sum(repeats),)


@given(repeats=REPEATS, seed=st.integers(0, 2**63 - 1))
def test_the_same_seed_gives_the_same_order(repeats, seed):
    assert np.array_equal(*(schedule(repeats, Order.SHUFFLED, seed).sequence() for _ in range(2)))


def test_another_seed_gives_another_order():
    orders = [tuple(schedule([20, 20], Order.SHUFFLED, seed).sequence()) for seed in range(5)]
    assert len(set(orders)) == 5
    assert all(order != tuple(sorted(order)) for order in orders)


@given(repeats=REPEATS)
def test_interleaved_events_are_spread_evenly(repeats):
    """Up to every repeat, an event was played its share of times, within one repeat of each event."""
    sequence = schedule(repeats, Order.INTERLEAVED).sequence()
    played = np.cumsum(sequence[:, None] == np.arange(len(repeats)), axis=0)
    share = np.arange(1, sum(repeats) + 1)[:, None] / sum(repeats) * np.array(repeats)
    assert np.abs(played - share).max() <= len(repeats)


def test_interleaved_events_of_equal_repeats_take_turns():
    assert schedule([2, 2, 2], Order.INTERLEAVED).sequence().tolist() == [0, 1, 2] * 2
    assert schedule([3, 1], Order.INTERLEAVED).sequence().tolist() == [0, 0, 1, 0]


def test_in_order_an_event_begins_when_the_one_before_has_ended():
    assert schedule([2, 0, 3], Order.IN_ORDER).sequence().tolist() == [0, 0, 2, 2, 2]


def test_nested_blocks_are_played_one_after_the_other():
    events = {name: Event(drive=f"{name}.drv") for name in ("a", "b", "c")}
    blocks = (Block(times=2, events={"b": 2, "a": 1}), Block(events={"c": 1, "a": 1}))
    plan = Schedule(name="some", rig="rig", events=events, order=Order.NESTED, blocks=blocks)
    assert plan.sequence().tolist() == [1, 1, 0, 1, 1, 0, 2, 0]
    assert plan.repeats == {"a": 3, "b": 4, "c": 1}
    assert plan.total_repeats == 8


def test_a_file_is_read_with_its_folder(tmp_path):
    plan = read_schedule(written(tmp_path, TEXT))
    assert (plan.name, plan.rig, plan.order, plan.folder) == ("weeks", "front_axle", Order.INTERLEAVED, tmp_path)
    assert plan.repeats == {"belgian": 5, "city": 2}
    assert plan.with_repeats({"belgian": 1, "city": 9}).sequence().tolist().count(1) == 9
    assert plan.with_repeats({"belgian": 1, "city": 9}).folder == tmp_path


def test_repeats_that_are_still_to_be_designed_are_refused_when_they_are_needed(tmp_path):
    plan = read_schedule(written(tmp_path, TEXT.replace(", repeats: 2", "")))
    with pytest.raises(ScheduleError, match=r"^repeats of city is missing; give it, or let `duralab schedule design`"):
        plan.sequence()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rig: front_axle", "", "rig is missing"),
        ("repeats: 5", "repeats: -5", "repeats is -5; it must be greater than or equal to 0"),
        ("repeats: 5", "repetitions: 5", "unknown key 'repetitions' in events.belgian"),
        (
            "repeats: 5",
            "repeats: 5, at_least: 3, at_most: 2",
            "at_least is 3 and at_most 2; at_least",
        ),
        (
            "repeats: 5",
            "repeats: 5, at_most: 4",
            "repeats is 5, and at_least and at_most allow 0 to 4; leave repeats out",
        ),
        ("repeats: 5", "repeats: 5, at_least: 6", "repeats is 5, and at_least and at_most allow 6 to "),
        ("repeats: 5", f"repeats: {MOST_REPEATS}", f"has {MOST_REPEATS + 2} repeats; {MOST_REPEATS} are allowed"),
        ("name: weeks", "name: weeks\nname: days", "it is not YAML: the key 'name' is given twice"),
        ("name: weeks", "name: weeks\norder: nested", "has no blocks; blocks belong to the order nested"),
        (
            "name: weeks",
            "name: weeks\nblocks: [{events: {city: 1}}]",
            "has blocks and the order interleaved; blocks belong to the order nested",
        ),
        (
            "name: weeks",
            "name: weeks\norder: nested\nblocks: [{events: {town: 1}}]",
            "blocks names the unknown event 'town'; known are belgian, city",
        ),
        (
            "name: weeks",
            "name: weeks\nplan: {mix: {town: {count: 3}}}",
            "plan.mix names the unknown event 'town'; known are belgian, city",
        ),
        ("name: weeks", "name: weeks\nplan: {largest_ratio: 1.2}", "needs either damage or mix; give one of them"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_sentence(tmp_path, old, new, sentence):
    path = written(tmp_path, TEXT.replace(old, new))
    with pytest.raises(ScheduleError) as caught:
        read_schedule(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert sentence in str(caught.value)
    assert str(caught.value).count(". ") == 0


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path):
    with pytest.raises(ScheduleError, match="it cannot be read"):
        read_schedule(tmp_path / "missing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(ScheduleError, match="it is not UTF-8 text"):
        read_schedule(tmp_path / "binary.yaml")


def test_no_repeats_at_all_are_refused():
    with pytest.raises(SettingsError, match="has no repeats at all"):
        schedule([0, 0], Order.IN_ORDER)


def test_repeats_beside_blocks_and_events_in_no_block_are_refused():
    events = {"a": Event(drive="a.drv"), "b": Event(drive="b.drv")}
    blocks = (Block(events={"a": 1}),)
    with pytest.raises(SettingsError, match="b is in no block"):
        Schedule(name="some", rig="rig", events=events, order=Order.NESTED, blocks=blocks)
    with pytest.raises(SettingsError, match="has repeats of an event beside blocks"):
        Schedule(name="some", rig="rig", events={"a": Event(drive="a", repeats=1)}, order=Order.NESTED, blocks=blocks)


def test_the_keep_rule_keeps_the_first_and_every_nth():
    rule = KeepRule(first=2, every=4)
    assert [nth for nth in range(10) if rule.keeps(nth)] == [0, 1, 4, 8]
    assert [nth for nth in range(10) if KeepRule(first=1, every=None).keeps(nth)] == [0]


def test_orders_differ():
    orders = [tuple(schedule([3, 3], order).sequence()) for order in FREE]
    assert all(a != b for a, b in combinations(orders, 2))
