"""Watchdogs: the first value outside, its name, limit and time; nothing where all is inside."""

import numpy as np
import pytest
from pydantic import ValidationError

from duralab_gateway.motion import Block, Source, WatchdogMonitor
from rig_sim.specimen.specimen import Range, WatchdogLimits, set_up_watchdogs


def dogs(**limits):
    return set_up_watchdogs(
        WatchdogLimits(**limits),
        responses={"left": "N", "right": "N"},
        drives={"ram": "m", "road": "m"},
        followed=["ram"],
        monitored=["ram.stroke", "ram.load_pressure", "supply.pressure"],
    )


def look(watchdogs, *, response=None, following=None, monitored=None, first_sample=0):
    block = Block(
        first_sample=first_sample,
        drive=np.zeros((2, 100)),
        response=np.zeros((2, 100)) if response is None else response,
        following_error=np.zeros((2, 100)) if following is None else following,
        monitored=np.zeros((3, 100)) if monitored is None else monitored,
    )
    return WatchdogMonitor(watchdogs, sample_rate=1000.0).first_trip(block)


def spike(rows, row, sample, value):
    block = np.zeros((rows, 100))
    block[row, sample:] = value
    return block


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_beyond_its_limit_trips_at_its_first_sample(sign):
    watchdogs = dogs(responses={"right": 500.0, "left": 100.0})
    trip = look(watchdogs, response=spike(2, 1, 40, sign * 501.0), first_sample=1200)
    assert (trip.watchdog.source, trip.watchdog.name) == (Source.RESPONSE, "right")
    assert (trip.value, trip.limit, trip.seconds) == (sign * 501.0, sign * 500.0, 1.24)
    assert trip.sentence == (
        f"the response of right was {sign * 501:g} N at 1.240 s, its watchdog allows -500 to 500 N"
    )


def test_what_is_at_its_limit_is_allowed():
    watchdogs = dogs(responses={"left": 100.0}, following_errors={"ram": 0.01})
    assert look(watchdogs, response=spike(2, 0, 3, 100.0), following=spike(2, 0, 3, -0.01)) is None


def test_an_actuator_that_does_not_follow_trips():
    trip = look(dogs(following_errors={"ram": 0.01}), following=spike(2, 0, 7, -0.011))
    assert trip.watchdog.source is Source.FOLLOWING_ERROR
    assert "following error of ram was -0.011 m at 0.007 s" in trip.sentence


def test_a_supply_that_sags_trips_at_its_lower_end():
    watchdogs = dogs(monitored={"supply.pressure": {"minimum": 2.0e7}})
    good = np.full((3, 100), 2.5e7)
    assert look(watchdogs, monitored=good) is None
    good[2, 60:] = 1.9e7
    trip = look(watchdogs, monitored=good)
    assert (trip.value, trip.limit, trip.seconds) == (1.9e7, 2.0e7, 0.06)


def test_the_earliest_of_several_is_the_one_that_is_told():
    watchdogs = dogs(responses={"left": 1.0, "right": 1.0}, following_errors={"ram": 0.01})
    response = spike(2, 0, 50, 2.0) + spike(2, 1, 30, 2.0)
    assert look(watchdogs, response=response, following=spike(2, 0, 40, 1.0)).watchdog.name == "right"
    assert look(watchdogs, response=response, following=spike(2, 0, 20, 1.0)).watchdog.name == "ram"


def test_a_value_that_is_not_a_number_trips():
    assert look(dogs(responses={"left": 1.0}), response=spike(2, 0, 5, np.nan)).seconds == 0.005


def test_nothing_is_watched_where_nothing_is_said():
    assert look(dogs(), response=np.full((2, 100), np.inf)) is None


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"responses": {"up": 1.0}}, "response of 'up'; there are left, right."),
        ({"following_errors": {"road": 1.0}}, "following error of 'road'; there are ram."),
        ({"monitored": {"oil": {"maximum": 1.0}}}, "monitored value of 'oil'; there are ram.stroke"),
    ],
)
def test_a_watchdog_on_nothing_is_refused(limits, said):
    with pytest.raises(ValueError, match=said):
        dogs(**limits)


@pytest.mark.parametrize("ends", [{}, {"minimum": 2.0, "maximum": 1.0}, {"maximum": np.nan}])
def test_a_range_without_ends_or_with_its_ends_swapped_is_refused(ends):
    with pytest.raises(ValidationError):
        Range(**ends)
