"""What a schedule comes to, and what is refused before anything moves."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_schedules import (
    DamagePlan,
    Event,
    EventLoad,
    KeepRule,
    Schedule,
    ScheduleError,
    forecast,
    in_bytes,
    require_room,
    require_within_plan,
)
from duralab_schedules.forecasting import kept_repeats

LOADS = {
    "belgian": EventLoad(samples=20_000, sample_rate=1000.0, drives=6, responses=6, damage={"left": 2.0, "right": 1.0}),
    "city": EventLoad(samples=5_000, sample_rate=1000.0, drives=6, responses=6, damage={"left": 0.5}),
}


def schedule(**changed):
    events = {"belgian": Event(drive="belgian.mcap", repeats=100), "city": Event(drive="city.mcap", repeats=40)}
    values = {"name": "weeks", "rig": "front_axle", "events": events, "keep": KeepRule(first=2, every=50)} | changed
    return Schedule(**values)


def test_duration_damage_and_bytes_are_sums_over_the_repeats():
    found = forecast(schedule(), LOADS, planned={"left": 440.0, "right": 200.0})
    assert found.seconds == 100 * 20 + 40 * 5
    assert found.damage == {"left": 220.0, "right": 100.0}
    assert found.ratio == {"left": 0.5, "right": 0.5}
    assert found.kept == {"belgian": 3, "city": 2}
    # Each drive once, six channels of it; and kept samples of twelve, with a tenth for how the bodies move.
    assert found.sample_bytes == 25_000 * 6 * 8 + round((3 * 20_000 + 2 * 5_000) * 12 * 8 * 1.1)
    # Of seven bands: 33 numbers of each response; and baselines of 80 Hz, five repeats long.
    assert found.statistics_bytes == 140 * (1100 + 6 * 33 * 8) + 5 * 80 * (20 + 5) * 6 * 16
    assert found.bytes == found.sample_bytes + found.statistics_bytes


@given(first=st.integers(0, 12), every=st.one_of(st.none(), st.integers(1, 9)), repeats=st.integers(0, 60))
def test_as_many_repeats_are_counted_as_the_rule_keeps(first, every, repeats):
    rule = KeepRule(first=first, every=every)
    assert kept_repeats(rule, repeats) == sum(rule.keeps(nth) for nth in range(repeats))


def test_more_damage_than_planned_is_refused():
    plan = DamagePlan(damage={"left": 200.0, "right": 50.0}, largest_ratio=1.9)
    given = schedule(plan=plan)
    expected = forecast(given, LOADS, planned=plan.damage)
    with pytest.raises(ScheduleError, match=r"puts 2 times the damage of its plan into right, and 1\.9 is allowed"):
        require_within_plan(expected, given)
    require_within_plan(expected, schedule(plan=plan.model_copy(update={"largest_ratio": 2.0})))
    require_within_plan(expected, schedule())


def test_a_plan_with_an_event_of_unknown_damage_is_refused():
    given = schedule(plan=DamagePlan(damage={"left": 200.0}))
    loads = LOADS | {"city": EventLoad(samples=5_000, sample_rate=1000.0, drives=6, responses=6)}
    expected = forecast(given, loads, planned={"left": 200.0})
    assert expected.unknown_damage == ("city",)
    with pytest.raises(ScheduleError, match="The damage of city is not known"):
        require_within_plan(expected, given)


def test_a_recording_that_is_larger_than_the_disk_is_refused():
    expected = forecast(schedule(), LOADS)
    require_room(expected, expected.bytes)
    with pytest.raises(ScheduleError, match=r"takes 9\.93 MB and 1 MB are free; keep fewer repeats"):
        require_room(expected, 10**6)


def test_bytes_are_written_with_three_digits():
    assert [in_bytes(n) for n in (0, 999, 1250, 3.2e6, 4.56e9, 7.2e12)] == [
        "0 bytes",
        "999 bytes",
        "1.25 kB",
        "3.2 MB",
        "4.56 GB",
        "7200 GB",
    ]
