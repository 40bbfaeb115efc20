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
    IterationHistory,
    Playback,
    StepStart,
    UpdateSettings,
    control_band,
    predict,
    rig_model,
    run_campaign,
)
from iterator.model import RateLimit, driven_lines
from iterator.updates import UPDATES, controlled_model, whole_model
from iterator.updates.rate_limits import within_rate_limits

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


def rig_with(rate):
    """Return a rig whose first actuator has a rate limit, and its model."""

    def rig(drive):
        first = followed(drive[0], rate)
        return play(impulse_responses(), np.stack((first, lag(drive[1]))))

    frequency, frf = frequency_response(impulse_responses())
    share = 1.0 - np.exp(-2.0 * np.pi * CORNER / SAMPLE_RATE)
    delay = np.exp(-2j * np.pi * frequency / SAMPLE_RATE)
    model = rig_model(
        frequency, frf * (share / (1.0 - (1.0 - share) * delay))[:, None, None], identified_band=(0.5, 40)
    )
    return rig, model


def campaign(settings, rate, *, target, playbacks=6, drive_map=None):
    rig, model = rig_with(rate)
    return run_campaign(
        rig,
        BAND.limit_target(target),
        model=model,
        settings=CampaignSettings(update=settings, stop=StopCriteria(iterations=playbacks, **NO_BOUNDS)),
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


def test_a_target_beyond_an_actuator_is_reached_more_closely_with_the_limit(limited, wanted):
    ignored = campaign(WITHOUT, wanted[1], target=wanted[0])
    assert ignored[-1].model.rate_limits == ()
    assert overall(limited)[-1] < 0.9 * overall(ignored)[-1]
    # Without the limit, the drive asks for more.
    assert largest_rate(limited[-1].drive[0]) < 0.9 * largest_rate(ignored[-1].drive[0])


@pytest.mark.parametrize(("coefficient", "looks"), [(None, True), (1e-9, False)])
def test_with_a_drive_map_that_moves_drives_no_limits_are_looked_for(wanted, coefficient, looks):
    terms = () if coefficient is None else (MapTerm(1, (0, 0), (coefficient, 0.0, 0.0)),)
    drive_map = DriveMap(("first", "second"), ("m", "m"), (0.004, 0.004), terms, SAMPLE_RATE, 40.0)
    iterations = campaign(SETTINGS, wanted[1], target=wanted[0], playbacks=5, drive_map=drive_map)
    assert any(iterations[-1].model.rate_limits) == looks


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


def bounded(drive, start, *, limits, target, playbacks=3):
    """Hold known limits in a step; the history says nothing about them."""
    rig, model = rig_with(np.inf)
    quiet = Playback(start, rig(start))
    history = IterationHistory(target=target, playbacks=(quiet,) * playbacks)
    lines = driven_lines(model, BAND)
    return within_rate_limits(
        drive,
        history,
        replace(model, rate_limits=limits),
        start=StepStart(model, start, BAND.limit_response(rig(start)), None),
        lines=lines,
        uncertainty=np.zeros((lines.size, 2, 2), dtype=complex),
        regularisation=1e-5,
        response_weight=1.0 / rms(target),
        drive_scale=rms(drive),
        band=BAND,
    )


def rates(limit, drive):
    """Speed of an actuator over its limit."""
    spectrum = np.fft.rfft(drive, 2 * drive.size)
    frequency = np.fft.rfftfreq(2 * drive.size, 1.0 / SAMPLE_RATE)
    return np.fft.irfft(limit.motion(frequency) * spectrum)[: drive.size]


def test_a_held_drive_asks_for_little_more_than_the_limit_and_costs_less_than_a_smaller_drive(wanted):
    _, model = rig_with(np.inf)
    target, drive = BAND.limit_target(wanted[0]), potholes()
    limit = RateLimit(CORNER, 0.5 * largest_rate(drive[0]))
    held = bounded(drive, potholes(depth=0.0), limits=(limit, None), target=target)
    assert held.limits == (limit, None)
    assert np.abs(rates(limit, drive[0])).max() > 1.9
    assert np.abs(rates(limit, held.drive[0])).max() < 1.02 * 1.3

    def missed(other):
        return np.sum((rms(predict(model, other, band=BAND) - predict(model, drive, band=BAND)) / rms(target)) ** 2)

    # A drive that fits everywhere by being smaller, and one whose first channel alone is.
    smaller = 1.3 / np.abs(rates(limit, drive[0])).max()
    assert 0.0 < missed(held.drive) < 0.3 * missed(drive * np.array([[smaller], [1.0]]))
    assert missed(held.drive) < 0.3 * missed(smaller * drive)
    # No other drive makes up for it: what it does beside its own response is known less well.
    assert held.drive[1].tobytes() == drive[1].tobytes()


def test_a_drive_that_has_been_played_may_be_played_again():
    """Where the drive stepped from asks for more than the limit already, it is left alone."""
    target = BAND.limit_target(rig_with(np.inf)[0](potholes(depth=8.0, strokes=(9.5,))))
    drive = potholes(strokes=(9.5,))
    limit = RateLimit(CORNER, 0.5 * largest_rate(drive[0]))
    assert bounded(drive, drive, limits=(limit, None), target=target).drive is drive
    assert bounded(1.01 * drive, drive, limits=(limit, None), target=target).drive[0].max() < 1.005 * drive[0].max()


def test_stretches_with_small_errors_are_left_alone(wanted):
    drive = potholes()
    limit = RateLimit(CORNER, 0.5 * largest_rate(drive[0]))
    target = BAND.limit_target(1.02 * wanted[0])
    step = 1.1 * drive
    assert bounded(step, drive, limits=(limit, None), target=target).drive is step


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


def test_limits_are_kept_while_no_further_evidence_is_found(wanted):
    limit = RateLimit(CORNER, 1e3)
    target = BAND.limit_target(wanted[0])
    assert bounded(potholes(), potholes(depth=0.0), limits=(None, limit), target=target).limits == (None, limit)


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
