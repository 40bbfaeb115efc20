from dataclasses import replace

import numpy as np
import pytest

from duralab_drive_map import DriveMap, MapTerm
from iterator import DriveLimits, LimitQuantity
from iterator.limits import project_mapped_drive, require_rest_within_limits

from .arc_rig import BAND, NAMES, UNITS, drive
from .linear_plants import SAMPLE_RATE

SQUARE = MapTerm(1, (0, 0), (0.4, 0.1, -0.03))


def drive_map(*terms):
    return DriveMap(NAMES, UNITS, (0.01, 0.002), terms, SAMPLE_RATE, 42.0)


def limits(maximum):
    allowed = np.asarray(maximum)
    return DriveLimits(NAMES, UNITS, -allowed, allowed, np.zeros(2), SAMPLE_RATE)


def test_a_follower_follows_what_the_limits_leave_of_its_leader():
    map_ = drive_map(SQUARE)
    mapped = map_.to_mapped(drive(seconds=20.0))
    free = map_.to_drive(mapped)
    peak = np.abs(free[0]).max()
    projection = project_mapped_drive(mapped, drive_map=map_, limits=limits((0.8 * peak, 1.0)), band=BAND)
    assert np.abs(projection.drive[0]).max() <= 0.8 * peak
    assert [passing.channel for passing in projection.passings] == ["vertical"]
    assert projection.passings[0].quantity is LimitQuantity.PEAK
    assert projection.saturated[0].any()
    assert not projection.saturated[1].any()
    # The rig sees v = T(u): lateral is what was asked for, though the vertical drive is not.
    np.testing.assert_allclose(map_.to_mapped(projection.drive)[1], mapped[1], atol=1e-12)
    assert np.abs(projection.drive[1] - free[1]).max() > 1e-3 * np.abs(free[1]).max()


def test_a_drive_that_fits_is_not_changed_by_the_limits():
    map_ = drive_map(SQUARE)
    mapped = drive(seconds=10.0)
    projection = project_mapped_drive(mapped, drive_map=map_, limits=limits((1.0, 1.0)), band=BAND)
    np.testing.assert_array_equal(projection.drive, map_.to_drive(mapped))
    assert projection.passings == ()


def test_a_drive_is_adjusted_before_it_is_projected_and_before_others_follow_it():
    map_ = drive_map(SQUARE)
    mapped = drive(seconds=10.0)
    asked = []

    def halve(i, samples):
        asked.append(i)
        return 0.5 * samples

    projection = project_mapped_drive(mapped, drive_map=map_, limits=limits((1.0, 1.0)), band=BAND, adjust=halve)
    assert asked == [0, 1]
    halved = map_.to_drive(np.vstack((0.5 * mapped[:1], mapped[1:])))
    np.testing.assert_allclose(projection.drive[1], 0.5 * halved[1], atol=1e-15)


def test_limits_that_do_not_hold_rest_or_are_of_another_rig_are_refused():
    map_, allowed = drive_map(SQUARE), limits((1.0, 1.0))
    off = replace(allowed, minimum=np.array([-1.0, 0.1]))
    with pytest.raises(ValueError, match=r"lateral are 0.1 to 1 m and the drive map rests at 0; shift the drive"):
        require_rest_within_limits(map_, off)
    with pytest.raises(ValueError, match="rests at 0"):
        project_mapped_drive(drive(seconds=5.0), drive_map=map_, limits=off, band=BAND)
    require_rest_within_limits(drive_map(), off)
    with pytest.raises(ValueError, match="learn the map again in the rig's units"):
        project_mapped_drive(drive(seconds=5.0), drive_map=map_, limits=replace(allowed, units=("mm", "m")), band=BAND)


def test_a_playback_made_before_the_map_is_kept_in_the_band():
    map_, u = drive_map(SQUARE), BAND.limit_response(drive(seconds=20.0))
    inside = BAND.limit_drive(map_.to_mapped(u))
    power = np.abs(np.fft.rfft(inside[1])) ** 2
    frequency = np.fft.rfftfreq(u.shape[1], 1.0 / SAMPLE_RATE)
    assert power[frequency < 0.9].sum() < 1e-3 * power.sum()
    middle = (frequency > 3.0) & (frequency < 30.0)
    wanted = np.abs(np.fft.rfft(map_.to_mapped(u)[1])) ** 2
    np.testing.assert_allclose(power[middle].sum(), wanted[middle].sum(), rtol=1e-2)
