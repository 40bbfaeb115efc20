"""Which repeats are recorded with all samples."""

import numpy as np
import pytest

from duralab_schedules import KeepRule
from sequencer.kept_samples import HeldRepeat, KeptSamples

RESPONSE = np.zeros((1, 4))


def held(repeat):
    return HeldRepeat(repeat, 0, 0, f"run{repeat}", RESPONSE)


def test_the_first_repeats_of_each_event_and_every_nth_are_kept():
    kept = KeptSamples(KeepRule(first=2, every=5, around_alarm=1))
    assert [nth for nth in range(12) if kept.keeps(100 + nth, nth)] == [0, 1, 5, 10]


def test_an_alarm_gives_those_before_it_once_and_keeps_those_after_it():
    kept = KeptSamples(KeepRule(first=0, every=None, around_alarm=2))
    for repeat in range(6):
        assert not kept.keeps(repeat, repeat)
        kept.hold(held(repeat))
    assert [each.repeat for each in kept.after_alarm(5)] == [3, 4, 5]
    assert kept.after_alarm(5) == []
    assert [repeat for repeat in range(6, 12) if kept.keeps(repeat, repeat)] == [6, 7]


def test_repeats_that_are_kept_anyway_do_not_push_others_out_of_reach():
    kept = KeptSamples(KeepRule(first=0, every=None, around_alarm=2))
    for repeat in (0, 1, 4):  # 2 and 3 were kept as signal blocks
        kept.hold(held(repeat))
    assert [each.repeat for each in kept.after_alarm(5)] == [4]


@pytest.mark.parametrize("around", [0, 1, 7])
def test_no_more_are_held_than_an_alarm_asks_for(around):
    kept = KeptSamples(KeepRule(around_alarm=around))
    for repeat in range(1000):
        kept.hold(held(repeat))
    assert len(kept.after_alarm(999)) == around + 1
