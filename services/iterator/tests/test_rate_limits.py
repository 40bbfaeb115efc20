"""Actuators with a rate limit: what they leave of a drive, how an update finds the limit, and what it makes of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from duralab_drive_map import DriveMap, MapTerm
from duralab_settings import StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    DriveLimits,
    IterationHistory,
    Playback,
    StepStart,
    UpdateSettings,
    control_band,
    rig_model,
    run_campaign,
)
from iterator.assessment import forecast_playback
from iterator.model import RateLimit, driven_lines, equivalent_drive
from iterator.updates import UPDATES, controlled_model, whole_model
from iterator.updates.rate_limits import FittedRig, drive_within_rate_limits, find_rate_limits, large_errors

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, play

BAND = control_band(1.0, 25.0, sample_rate=SAMPLE_RATE, lower_flank=0.5, upper_flank=3.0)
CORNER = 20.0
SETTINGS = UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.SECANT, accept_segments=True)
WITHOUT = SETTINGS.without_rate_limits
SAMPLES = 4000


def followed(drive, rate, *, corner=CORNER, sample_rate=SAMPLE_RATE):
    """Motion of an actuator, sample after sample; the update computes only stretches at the limit."""
    share, motion, made = 1.0 - np.exp(-2.0 * np.pi * corner / sample_rate), 0.0, []
    for wanted in drive:
        motion += float(np.clip(share * (wanted - motion), -rate / sample_rate, rate / sample_rate))
        made.append(motion)
    return np.array(made)


def lag(drive, *, corner=CORNER, sample_rate=SAMPLE_RATE):
    share = 1.0 - np.exp(-2.0 * np.pi * corner / sample_rate)
    return lfilter([share], [1.0, share - 1.0], drive)


def potholes(*, depth=6.0, strokes=(5.0, 9.5, 14.0), seed=3):
    """Drive of a quiet road with fast strokes of the first channel at some times, s."""
    noise = np.random.default_rng(seed).standard_normal((2, SAMPLES))
    smooth = sosfiltfilt(butter(2, (2.0, 12.0), "bandpass", fs=SAMPLE_RATE, output="sos"), noise)
    time = np.arange(SAMPLES) / SAMPLE_RATE
    for at in strokes:
        smooth[0] += depth * np.exp(-(((time - at) / 0.03) ** 2))
    return 0.004 * smooth * np.clip(np.minimum(time, time[::-1]) / 2.0 - 0.5, 0.0, 1.0)


def largest_rate(drive):
    return float(np.abs(np.diff(lag(drive), prepend=0.0)).max()) * SAMPLE_RATE


def rig_with(rate, *, arc=0.0):
    """Return a rig whose first actuator has a rate limit, and its model.

    The second response also follows the square of the drive that moves the first actuator so without a limit.
    """
    limits = (RateLimit(CORNER, rate), None)

    def rig(drive):
        first = followed(drive[0], rate)
        equivalent = equivalent_drive(drive, limits, sample_rate=SAMPLE_RATE) if arc else drive
        return play(impulse_responses(), np.stack((first, lag(drive[1] + arc * equivalent[0] ** 2))))

    frequency, frf = frequency_response(impulse_responses())
    share = 1.0 - np.exp(-2.0 * np.pi * CORNER / SAMPLE_RATE)
    delay = np.exp(-2j * np.pi * frequency / SAMPLE_RATE)
    model = rig_model(
        frequency, frf * (share / (1.0 - (1.0 - share) * delay))[:, None, None], identified_band=(0.5, 40)
    )
    return rig, model


def campaign(settings, rate, *, target, playbacks=6, drive_map=None, arc=0.0, speed=None, levels=()):
    rig, model = rig_with(rate, arc=arc)
    limits = DriveLimits(
        ("first", "second"), ("m", "m"), -np.ones(2), np.ones(2), np.zeros(2), SAMPLE_RATE, actuator_speed=speed
    )
    return run_campaign(
        rig,
        BAND.limit_target(target),
        model=model,
        settings=CampaignSettings(
            update=settings, stop=StopCriteria(iterations=playbacks, **NO_BOUNDS), levels=levels, largest_overrun=10.0
        ),
        limits=limits,
        drive_map=drive_map,
    ).iterations


@pytest.fixture(scope="module")
def wanted():
    """Target of the rig without a limit, and the limit that keeps its first actuator from it."""
    rig, _ = rig_with(np.inf)
    return rig(potholes()), 0.6 * largest_rate(potholes()[0])


@pytest.fixture(scope="module")
def limited(wanted):
    return campaign(SETTINGS, wanted[1], target=wanted[0])


@pytest.fixture(scope="module")
def ignored(wanted):
    return campaign(WITHOUT, wanted[1], target=wanted[0])


def overall(iterations):
    return np.array([each.metrics.overall_relative_rms_error for each in iterations])


@pytest.mark.parametrize("share", [0.9, 0.5, 0.2])
def test_a_drive_less_what_is_held_back_gives_the_limited_motion_without_a_limit(share):
    drive = potholes()[0]
    limit = RateLimit(CORNER, share * largest_rate(drive))
    everywhere = np.ones(SAMPLES, dtype=bool)
    missing = limit.held_back(drive, sample_rate=SAMPLE_RATE, where=everywhere)
    assert 0 < np.count_nonzero(missing) < SAMPLES
    motion = followed(drive, limit.rate)
    assert np.abs(lag(drive) - motion).max() > 0.02 * np.abs(motion).max()
    np.testing.assert_allclose(lag(drive + missing), motion, atol=2e-3 * limit.rate / SAMPLE_RATE)


def test_a_drive_that_reaches_no_limit_or_only_elsewhere_holds_nothing_back():
    drive = potholes()[0]
    everywhere = np.ones(SAMPLES, dtype=bool)
    faster = RateLimit(CORNER, 1.01 * largest_rate(drive))
    assert not faster.held_back(drive, sample_rate=SAMPLE_RATE, where=everywhere).any()
    slow = RateLimit(CORNER, 0.5 * largest_rate(drive))
    late = np.arange(SAMPLES) > 12 * SAMPLE_RATE
    held_back = slow.held_back(drive, sample_rate=SAMPLE_RATE, where=late)
    assert held_back[late].any()
    assert not held_back[~late].any()


def test_the_speed_of_a_tone_reaches_one_where_its_amplitude_reaches_the_limit():
    """A tone of 1 at the corner frequency moves a lagging actuator by 1 / √2."""
    limit = RateLimit(CORNER, 2.0 * np.pi * CORNER / np.sqrt(2.0))
    assert np.abs(limit.motion(np.array([CORNER])))[0] == pytest.approx(1.0)
    assert limit.motion(np.array([0.0]))[0] == 0.0


def test_the_limit_of_an_actuator_is_found_and_that_of_another_is_not_invented(limited, wanted):
    first, second = limited[-1].model.rate_limits
    assert first.rate == pytest.approx(wanted[1], rel=0.2)
    assert second is None


def test_a_target_beyond_an_actuator_is_reached_more_closely_with_the_limit(limited, ignored):
    assert ignored[-1].model.rate_limits == ()
    assert overall(limited)[-1] < 0.9 * overall(ignored)[-1]
    # Without the limit, the drive asks for more with each playback; with it, for no more than before it was known.
    asked = [largest_rate(each.drive[0]) for each in limited]
    assert limited[2].model.rate_limits == (None, None)
    assert max(asked[3:]) < 1.02 * asked[2] < largest_rate(ignored[-1].drive[0])


def test_the_model_learns_from_the_motion_and_not_from_what_an_actuator_could_not_follow(limited, ignored):
    _, true = rig_with(np.inf)
    lines = driven_lines(true, BAND)

    def wrong(iterations):
        difference = iterations[-1].model.frf[lines, :, 0] - true.frf[lines, :, 0]
        return np.linalg.norm(difference) / np.linalg.norm(true.frf[lines, :, 0])

    assert wrong(limited) < 0.1
    assert wrong(ignored) > 0.3


@pytest.mark.parametrize(("coefficient", "looks"), [(None, True), (1e-9, False)])
def test_with_a_drive_map_that_moves_drives_no_limits_are_looked_for(wanted, coefficient, looks):
    terms = () if coefficient is None else (MapTerm(1, (0, 0), (coefficient, 0.0, 0.0)),)
    drive_map = DriveMap(("first", "second"), ("m", "m"), (0.004, 0.004), terms, SAMPLE_RATE, 40.0)
    iterations = campaign(SETTINGS, wanted[1], target=wanted[0], playbacks=5, drive_map=drive_map)
    assert any(iterations[-1].model.rate_limits) == looks


def test_limits_that_the_rig_states_are_used_and_none_is_looked_for(limited, ignored, wanted):
    speed = np.array([wanted[1], 0.0])
    stated = campaign(SETTINGS, wanted[1], target=wanted[0], speed=speed)
    for each in stated[2:]:
        assert each.model.rate_limits == (RateLimit(0.9 * 25.0, wanted[1]), None)
    assert overall(stated)[-1] < 0.9 * overall(ignored)[-1]
    assert overall(stated)[-1] < 1.1 * overall(limited)[-1]
    switched_off = campaign(WITHOUT, wanted[1], target=wanted[0], speed=speed, playbacks=4)
    assert switched_off[-1].drive.tobytes() == ignored[3].drive.tobytes()


def test_a_stated_limit_is_divided_by_the_level_as_the_drives_are(wanted):
    speed = np.array([wanted[1], 0.0])
    stated = campaign(SETTINGS, wanted[1], target=wanted[0], speed=speed, levels=(0.5, 0.5, 0.5, 1.0), playbacks=6)
    assert [each.model.rate_limits[0].rate for each in stated if each.model.rate_limits] == [2.0 * wanted[1], wanted[1]]


def test_with_a_drive_map_the_stated_speeds_keep_followers_from_motions_that_are_not_made():
    """The second drive makes up for the square of the first, which its actuator does not reach."""
    arc = 20.0
    rig, _ = rig_with(np.inf, arc=arc)
    drive_map = DriveMap(
        ("first", "second"),
        ("m", "m"),
        (0.004, 0.004),
        (MapTerm(1, (0, 0), (0.004 * arc, 0.0, 0.0)),),
        SAMPLE_RATE,
        40.0,
    )
    fast = potholes()
    target, rate = rig(drive_map.to_drive(fast)), 0.6 * largest_rate(fast[0])
    both = np.array([rate, rate])
    stated, before = (
        campaign(SETTINGS, rate, target=target, drive_map=drive_map, arc=arc, speed=speed) for speed in (both, None)
    )
    assert not any(before[-1].model.rate_limits)
    off = campaign(WITHOUT, rate, target=target, drive_map=drive_map, arc=arc, speed=both, playbacks=3)
    assert off[-1].drive.tobytes() == before[2].drive.tobytes()
    # The second drive follows the first: its actuator does not move with its mapped drive.
    assert stated[-1].model.rate_limits == (RateLimit(0.9 * 25.0, rate), None)
    assert overall(stated)[-1] < 0.8 * overall(before)[-1]


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_rig_without_limits_has_the_bytes_of_an_update_that_looks_for_none(noise):
    rig, model = rig_with(np.inf)
    wrong = replace(model, inverse_frf=0.6 * model.inverse_frf)
    runs = []
    for settings in (SETTINGS, WITHOUT):
        rng = np.random.default_rng(4)
        runs.append(
            run_campaign(
                lambda drive, rng=rng: rig(drive) + noise * rng.standard_normal(drive.shape),
                BAND.limit_target(rig(potholes())),
                model=wrong,
                settings=CampaignSettings(update=settings, stop=StopCriteria(iterations=5, **NO_BOUNDS)),
            ).iterations
        )
    for one, other in zip(*runs, strict=True):
        assert one.drive.tobytes() == other.drive.tobytes()


def fitted_to(drive, limits, *, target):
    """Return the fitted rig, without actuators' limits but with some known before."""
    _, model = rig_with(np.inf)
    lines = driven_lines(model, BAND)
    return FittedRig(
        replace(model, rate_limits=limits),
        lines=lines,
        uncertainty=np.zeros((lines.size, 2, 2), dtype=complex),
        regularisation=1e-5,
        response_weight=1.0 / rms(target),
        drive_scale=rms(drive),
        band=BAND,
    )


def held(wanted, start, limit, *, target, step_gain=None):
    """Hold a limit in a step from a drive that was played to one that moves the actuators as is wanted."""
    rig, model = rig_with(limit.rate)
    return drive_within_rate_limits(
        wanted,
        (limit, None),
        fitted_to(wanted, (limit, None), target=target),
        moved_from=equivalent_drive(start, (limit, None), sample_rate=SAMPLE_RATE),
        played=StepStart(model, start, BAND.limit_response(rig(start)), step_gain),
        large=np.ones(SAMPLES, dtype=bool),
    )


def test_a_held_drive_comes_nearer_to_the_target_than_any_that_ignores_the_limit_or_is_smaller(wanted):
    """All of them are played by the rig whose actuator has the limit."""
    target, drive = BAND.limit_target(wanted[0]), potholes()
    limit = RateLimit(CORNER, 0.5 * largest_rate(drive[0]))
    rig, _ = rig_with(limit.rate)

    def missed(other):
        return np.sum((rms(target - BAND.limit_response(rig(other))) / rms(target)) ** 2)

    made = held(drive, potholes(depth=0.0), limit, target=target)
    # Drives that hold the limit by being smaller: all of it, or the first channel.
    smaller = limit.rate / largest_rate(drive[0])
    others = [missed(share * drive) for share in np.linspace(smaller, 1.5, 9)]
    others += [missed(drive * np.array([[share], [1.0]])) for share in np.linspace(smaller, 1.5, 9)]
    assert 0.0 < missed(made) < 0.8 * min(others)
    # No content outside the band, though the motion at the limit has some, and no other drive that makes up for it.
    np.testing.assert_allclose(BAND.limit_drive(made)[0], made[0], atol=0.02 * np.abs(made[0]).max())
    np.testing.assert_allclose(made[1], drive[1], atol=0.01 * np.abs(drive[1]).max())


def test_a_drive_in_the_band_is_found_that_moves_a_limited_actuator_as_is_wanted(wanted):
    """The motion is what counts: what a drive asks for beyond the limit is no error."""
    target = BAND.limit_target(wanted[0])
    limit = RateLimit(CORNER, 0.5 * largest_rate(potholes()[0]))
    start = potholes(depth=9.0)
    at_start, at_end = (
        equivalent_drive(each, (limit, None), sample_rate=SAMPLE_RATE) for each in (start, potholes(depth=5.0))
    )
    again = held(at_start, start, limit, target=target)
    np.testing.assert_allclose(again, start, rtol=0.0, atol=1e-12 * np.abs(start).max())
    made = held(at_end, start, limit, target=target)
    moved = equivalent_drive(made, (limit, None), sample_rate=SAMPLE_RATE)

    def apart(one, other):
        return rms(BAND.limit_drive(one - other))[0]

    assert apart(moved, at_end) < 0.2 * apart(at_start, at_end)


def test_where_the_last_step_was_worse_more_of_what_was_played_is_kept(wanted):
    target = BAND.limit_target(wanted[0])
    limit = RateLimit(CORNER, 0.5 * largest_rate(potholes()[0]))
    start = potholes(depth=9.0)
    moved = equivalent_drive(potholes(depth=5.0), (limit, None), sample_rate=SAMPLE_RATE)
    changes = [
        rms(held(moved, start, limit, target=target, step_gain=np.full(SAMPLES, gain)) - start)[0]
        for gain in (1.0, 0.5, 0.1)
    ]
    assert changes[0] > changes[1] > changes[2]


def test_errors_count_as_large_in_short_stretches_and_sooner_after_three_playbacks(wanted):
    rig, _ = rig_with(np.inf)
    drive = potholes()
    target = BAND.limit_target(rig(drive))
    fitted = fitted_to(drive, (), target=target)
    played = Playback(drive, target)

    def large(response, playbacks):
        history = IterationHistory(target=target, playbacks=(played,) * playbacks)
        return large_errors(history, fitted, start=StepStart(fitted.model, drive, response, None))

    pothole = np.exp(-(((np.arange(SAMPLES) / SAMPLE_RATE - 9.5) / 0.1) ** 2))
    missing = 0.6 * rms(target)[:, None] * pothole
    assert not large(target, 3).any()
    found = large(target - missing, 3)
    assert found[round(9.5 * SAMPLE_RATE)]
    assert np.mean(found) < 0.05
    assert not large(target - missing, 2).any()
    assert large(target - 3.0 * missing, 2).any()
    # Nearly everywhere: not what a limit causes.
    assert not large(0.5 * target, 3).any()


@pytest.mark.parametrize(("share", "kept"), [(2.0, True), (0.5, False)])
def test_a_limit_is_kept_without_further_evidence_unless_a_drive_is_followed_beyond_it(share, kept):
    rig, _ = rig_with(np.inf)
    drive = potholes(strokes=(5.0,))
    target = BAND.limit_target(rig(drive))
    limit = RateLimit(CORNER, share * largest_rate(drive[0]))
    fitted = fitted_to(drive, (limit, None), target=target)
    history = IterationHistory(target=target, playbacks=(Playback(drive, target),) * 3)
    large = np.abs(np.arange(SAMPLES) / SAMPLE_RATE - 14.0) < 0.2
    found = find_rate_limits(history, fitted, start=StepStart(fitted.model, drive, target, None), large=large)
    assert found == (limit if kept else None, None)


def test_a_forecast_expects_nothing_of_what_a_limit_holds_back(wanted):
    limit = RateLimit(CORNER, 0.5 * largest_rate(potholes()[0]))
    rig, _ = rig_with(limit.rate)
    _, model = rig_with(np.inf)
    target = BAND.limit_target(wanted[0])
    before, drive = potholes(depth=3.0), potholes(depth=8.0)
    history = IterationHistory(target=target, playbacks=(Playback(before, BAND.limit_response(rig(before))),))
    measured = BAND.limit_response(rig(drive))

    def missed(limits):
        known = replace(model, rate_limits=limits)
        made = forecast_playback(drive, known, history, band=BAND, level=1.0, earlier=())
        return rms(made.response - measured) / rms(measured)

    assert np.all(missed((limit, None)) < 0.02)
    assert np.all(missed(()) > 0.1)


def test_no_limits_are_looked_for_where_nearly_every_error_is_large(wanted):
    rig, model = rig_with(wanted[1])
    target, small = BAND.limit_target(wanted[0]), 0.2 * potholes()
    history = IterationHistory(target=target)
    for drive in (small, potholes(), small):
        history = history.after(Playback(drive, BAND.limit_response(rig(drive))))
    last = SETTINGS.model_copy(update={"accept_segments": False})
    assert UPDATES[UpdateKind.SECANT](history, model, last).model.rate_limits == (None, None)
    near = history.after(Playback(potholes(), BAND.limit_response(rig(potholes()))))
    assert any(UPDATES[UpdateKind.SECANT](near, model, last).model.rate_limits)


def test_two_playbacks_are_needed(wanted):
    rig, model = rig_with(wanted[1])
    drive = potholes()
    history = IterationHistory(target=BAND.limit_target(wanted[0])).after(
        Playback(drive, BAND.limit_response(rig(drive)))
    )
    assert UPDATES[UpdateKind.SECANT](history, model, SETTINGS).model.rate_limits == ()
    # One playback is what is left where the level changes; a limit of the level before does not hold.
    known = replace(model, rate_limits=(RateLimit(CORNER, 1.0), None))
    assert UPDATES[UpdateKind.SECANT](history, known, SETTINGS).model.rate_limits == ()


def test_watched_responses_have_no_part_in_rate_limits():
    model = replace(rig_with(np.inf)[1], rate_limits=(RateLimit(CORNER, 1.0), None))
    controlled = np.array([False, True])
    kept = controlled_model(model, controlled)
    assert kept.rate_limits == model.rate_limits
    assert whole_model(kept, identified=rig_with(np.inf)[1], controlled=controlled).rate_limits == model.rate_limits
