"""Which repeats are recorded with all samples."""

import numpy as np
import pytest

from duralab_schedules import KeepRule
from sequencer.kept_samples import HeldFiles, HeldRepeat, KeptSamples

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


def test_a_crash_loses_no_repeat_that_an_alarm_may_ask_for(tmp_path):
    warned = []
    rule, files = KeepRule(first=0, every=None, around_alarm=2), HeldFiles(tmp_path / "test", warn=warned.append)
    crashed = KeptSamples(rule, files=files)
    for repeat in range(9):
        crashed.hold(HeldRepeat(repeat, 1, 2, f"run{repeat}", np.full((2, 4), repeat / 3.0)))
    assert len(list((tmp_path / "test").iterdir())) == 3
    # Torn by a loss of power, and left over by a crash in the middle of a write.
    (tmp_path / "test" / "000000099.npz").write_bytes(b"PK")
    (tmp_path / "test" / "000000098.part").write_bytes(b"PK")
    again = KeptSamples(rule, files=files)
    # The end of repeat 8 is not known: the crash came before its step was stored.
    assert again.restore(next_repeat=8, stored=set()) == []
    assert "000000099.npz cannot be read" in warned[0]
    before = again.after_alarm(9)
    assert [(each.repeat, each.event, each.drive, each.run) for each in before] == [(7, 1, 2, "run7")]
    np.testing.assert_array_equal(before[0].response, np.full((2, 4), 7 / 3.0))
    for each in before:
        again.forget(each)
    again.close()
    assert list(tmp_path.iterdir()) == []


def test_what_an_alarm_asked_for_before_a_crash_is_stored_once_after_it(tmp_path):
    rule, files = KeepRule(first=0, every=None, around_alarm=2), HeldFiles(tmp_path, warn=pytest.fail)
    crashed = KeptSamples(rule, files=files)
    for repeat in range(6):
        crashed.hold(held(repeat))
    assert [each.repeat for each in crashed.after_alarm(5)] == [3, 4, 5]
    # It ended after the step of repeat 3 was stored and before that of 4.
    again = KeptSamples(rule, kept_before=8, files=files)
    assert [each.repeat for each in again.restore(next_repeat=6, stored={3})] == [4, 5]
    assert again.after_alarm(5) == []


def test_a_disk_that_takes_nothing_leaves_repeats_in_memory(tmp_path):
    (tmp_path / "file").touch()
    warned = []
    files = HeldFiles(tmp_path / "file" / "folder", warn=warned.append)
    kept = KeptSamples(KeepRule(around_alarm=1), files=files)
    kept.hold(held(3))
    assert "Repeat 3 is held in memory only" in warned[0]
    assert [each.repeat for each in kept.after_alarm(3)] == [3]
