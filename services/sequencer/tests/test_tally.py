"""What is counted: every repeat once, damage as measured, or as planned where the end is not known."""

import numpy as np
import pytest

from sequencer.tally import EventTally, correction_damage, planned_damage, total_damage

PLANNED = np.array([3.0, 1.0])


def tally(planned=4, damage=PLANNED):
    return EventTally.begun(planned, damage, responses=2)


def test_a_measured_repeat_counts_with_its_damage():
    event = tally()
    event.count_measured(np.array([2.0, 5.0]))
    event.count_measured(np.array([1.0, 0.5]))
    assert (event.played, event.measured, event.unknown) == (2, 2, 0)
    np.testing.assert_array_equal(event.damage, [3.0, 5.5])


def test_a_repeat_whose_end_is_not_known_counts_as_played_with_the_damage_planned():
    event = tally()
    event.count_measured(np.array([2.0, 5.0]))
    np.testing.assert_array_equal(event.count_unknown(), PLANNED)
    assert (event.played, event.measured, event.unknown) == (2, 1, 1)
    np.testing.assert_array_equal(event.damage, [5.0, 6.0])


def test_without_a_plan_the_mean_of_those_measured_counts_and_nothing_before_the_first():
    event = tally(damage=None)
    assert event.count_unknown() is None
    np.testing.assert_array_equal(event.damage, 0.0)
    for damage in (2.0, 4.0):
        event.count_measured(np.array([damage, damage]))
    np.testing.assert_array_equal(event.count_unknown(), [3.0, 3.0])
    # One that was counted so does not change the mean.
    np.testing.assert_array_equal(event.damage_per_repeat, [3.0, 3.0])
    np.testing.assert_array_equal(event.damage, [9.0, 9.0])


def test_planned_damage_is_that_of_what_was_played_or_of_the_whole_schedule():
    first, second = tally(planned=4), tally(planned=10, damage=np.array([0.5, 0.0]))
    first.count_measured(np.zeros(2))
    second.count_unknown()
    second.count_unknown()
    np.testing.assert_array_equal(planned_damage([first, second], whole=False), [3.0 + 1.0, 1.0])
    np.testing.assert_array_equal(planned_damage([first, second], whole=True), [12.0 + 5.0, 4.0])
    np.testing.assert_array_equal(total_damage([first, second]), [1.0, 0.0])


def test_a_correction_adds_damage_and_neither_a_repeat_nor_a_plan():
    event = tally()
    event.count_measured(np.array([2.0, 5.0]))
    event.count_correction(2, np.array([0.5, 1.0]))
    event.count_correction(1, None)
    assert (event.played, event.measured, event.correction_playbacks) == (1, 1, 3)
    np.testing.assert_array_equal(event.damage, [2.5, 6.0])
    np.testing.assert_array_equal(event.measured_damage, [2.0, 5.0])
    np.testing.assert_array_equal(correction_damage([event, tally()]), [0.5, 1.0])
    np.testing.assert_array_equal(planned_damage([event], whole=False), PLANNED)


@pytest.mark.parametrize("whole", [True, False])
def test_planned_damage_is_not_known_where_that_of_one_event_is_not(whole):
    known, unknown = tally(), tally(damage=None)
    unknown.count_unknown()
    assert planned_damage([known, unknown], whole=whole) is None


def test_an_event_that_is_not_played_needs_no_plan():
    assert planned_damage([tally(), tally(planned=0, damage=None)], whole=True) is not None
