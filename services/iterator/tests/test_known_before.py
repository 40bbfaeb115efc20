"""A campaign that starts from what earlier ones left: their playbacks, their drive."""

import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import CampaignSettings, RecordedPlayback, UpdateSettings, control_band, iterate, rig_model
from iterator.playbacks import FirstDrive, KnownBefore

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
H = impulse_responses()
LEARNING = (UpdateKind.SECANT, UpdateKind.ADAPTIVE_MODELLING)


def wrong_model():
    frequency, frf = frequency_response(H)
    return rig_model(frequency, 1.6 * frf, identified_band=(1.0, 70.0))


def errors(kind, target, *, iterations=1, known=None, gain=1.0, rig=H, drive_of=None):
    """Errors of each playback on the linear plant, and the playbacks."""
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind),
        stop=StopCriteria(iterations=iterations),
    )
    options = {} if known is None else {"known": known}
    steps = list(
        iterate(
            lambda drive: play(rig, drive), BAND.limit_target(target), model=wrong_model(), settings=settings, **options
        )
    )
    if drive_of is not None:
        drive_of.extend(step.drive for step in steps)
    found = [float(np.max(step.metrics.relative_rms_error)) for step in steps]
    return found, tuple(RecordedPlayback(step.drive, step.response) for step in steps)


@pytest.mark.parametrize("kind", LEARNING)
@pytest.mark.parametrize("samples", [8000, 5001])
def test_the_first_drive_of_another_target_profits_from_the_playbacks_of_a_campaign(kind, samples):
    # The model is 1.6 times too high, so a first drive misses 0.375 of the target until something is learned.
    _, before = errors(kind, noise_target(8000, seed=3), iterations=3)
    (alone,), _ = errors(kind, noise_target(samples, seed=4))
    (known,), _ = errors(kind, noise_target(samples, seed=4), known=KnownBefore((before,)))
    assert alone == pytest.approx(0.375, rel=0.02)
    assert known < 0.2 * alone


def test_basic_twr_learns_nothing_from_others():
    drives, again = [], []
    target = noise_target(8000, seed=4)
    _, before = errors(UpdateKind.SECANT, noise_target(8000, seed=3), iterations=2)
    errors(UpdateKind.BASIC_TWR, target, drive_of=drives)
    errors(UpdateKind.BASIC_TWR, target, known=KnownBefore((before,)), drive_of=again)
    np.testing.assert_array_equal(drives[0], again[0])


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_a_drive_with_its_response_is_scaled_to_a_target_that_resembles_it(kind):
    target = noise_target(8000, seed=3)
    reached, before = errors(kind, target, iterations=8, gain=0.8)
    known = KnownBefore(first_drive=FirstDrive(before[-1].drive, before[-1].response))
    (first,), _ = errors(kind, 0.4 * target, known=known)
    # A linear rig scales: what the first drive misses is what the model misses of what was missing.
    assert first <= reached[-1] < 0.02


def test_a_drive_without_its_response_is_played_as_it_is():
    drives = []
    narrower = control_band(4.0, 45.0, sample_rate=SAMPLE_RATE)
    given = narrower.limit_drive(1e-3 * noise_target(8000, seed=9, level=(1.0, 1.0)))
    known = KnownBefore(first_drive=FirstDrive(given))
    errors(UpdateKind.SECANT, noise_target(8000, seed=4), known=known, drive_of=drives)
    np.testing.assert_allclose(drives[0], given, atol=1e-9)


def worn(target):
    """Playbacks of the campaign on the new rig, and one of its best drive on a rig that lost a quarter of its gain."""
    _, before = errors(UpdateKind.SECANT, target, iterations=3)
    drive = before[-1].drive
    return before, RecordedPlayback(drive, play(0.75 * H, drive))


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_the_response_of_a_first_drive_to_this_target_counts_as_a_playback(kind):
    target, drives = noise_target(8000, seed=4), []
    before, noticed = worn(target)
    first = FirstDrive(noticed.drive, noticed.response, of_this_target=True)
    errors(kind, target, rig=0.75 * H, known=KnownBefore((before,), first), drive_of=drives)
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=kind), stop=StopCriteria(iterations=2)
    )
    _, second = iterate(
        lambda drive: play(0.75 * H, drive),
        BAND.limit_target(target),
        model=wrong_model(),
        settings=settings,
        recorded=[noticed],
        known=KnownBefore((before,)),
    )
    np.testing.assert_allclose(drives[0], second.drive, atol=1e-4 * np.abs(second.drive).max())


def test_a_drive_that_resembles_nothing_changes_little():
    target = noise_target(8000, seed=4)
    (alone,), _ = errors(UpdateKind.BASIC_TWR, target)
    _, before = errors(UpdateKind.BASIC_TWR, noise_target(8000, seed=30), iterations=4)
    (first,), _ = errors(
        UpdateKind.BASIC_TWR, target, known=KnownBefore(first_drive=FirstDrive(before[-1].drive, before[-1].response))
    )
    assert first == pytest.approx(alone, rel=0.02)


def test_what_is_known_leaves_later_playbacks_the_same_when_they_are_gone_through_again():
    kind, target = UpdateKind.SECANT, noise_target(8000, seed=4)
    _, before = errors(kind, noise_target(6000, seed=3), iterations=2)
    known = KnownBefore((before,), FirstDrive(*(np.pad(each, ((0, 0), (0, 2000))) for each in _pair(before[-1]))))
    drives = []
    _, played = errors(kind, target, iterations=4, known=known, drive_of=drives)
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=kind), stop=StopCriteria(iterations=4)
    )
    again = list(
        iterate(
            lambda drive: play(H, drive),
            BAND.limit_target(target),
            model=wrong_model(),
            settings=settings,
            recorded=played[:2],
            known=known,
        )
    )
    for step, drive in zip(again, drives, strict=True):
        assert step.drive.tobytes() == drive.tobytes()


def _pair(playback):
    return playback.drive, playback.response
