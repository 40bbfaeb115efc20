"""Partial levels and recorded playbacks: what the loop makes of them, on a linear plant and on one with friction."""

import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    CampaignSettings,
    DriveLimitError,
    DriveLimits,
    RecordedPlayback,
    UpdateSettings,
    control_band,
    iterate,
    rig_model,
)

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)


def settings(*, levels=(), iterations=4, kind=UpdateKind.BASIC_TWR, gain=0.5, reach=0.0):
    update = UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind)
    stop = StopCriteria(iterations=iterations, relative_rms_error=reach)
    return CampaignSettings(update=update, stop=stop, levels=levels)


def linear(drive):
    return play(impulse_responses(), drive)


def sticking(drive):
    """A plant that moves the less, the less it is driven: friction."""
    response = linear(drive)
    friction = 0.2 * np.array([[900.0], [40.0]])
    return response - friction * np.tanh(response / friction)


def run(plant, given, **more):
    model = rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))
    return list(iterate(plant, BAND.limit_target(noise_target(4000)), model=model, settings=given, **more))


def test_a_linear_plant_converges_alike_at_every_level_and_feels_the_share_only():
    whole, partial = run(linear, settings()), run(linear, settings(levels=(0.5, 0.75, 1.0)))
    assert [iteration.level for iteration in partial] == [0.5, 0.75, 1.0, 1.0]
    for a, b in zip(whole, partial, strict=True):
        np.testing.assert_allclose(b.drive, b.level * a.drive, rtol=0.0, atol=1e-12 * np.abs(a.drive).max())
        np.testing.assert_allclose(b.metrics.relative_rms_error, a.metrics.relative_rms_error, rtol=1e-9)


def test_the_target_is_not_reached_at_a_part_of_its_size():
    # After one playback at gain 1 the error is far below 0.1, but that is half of the target.
    iterations = run(linear, settings(levels=(0.5, 1.0), gain=1.0, reach=0.1))
    assert [iteration.outcome is None for iteration in iterations] == [True, False]


def test_errors_of_another_level_are_not_compared():
    iterations = run(sticking, settings(levels=(0.25, 0.25, 0.5, 1.0), iterations=6, gain=0.8))
    errors = [iteration.metrics.overall_relative_rms_error for iteration in iterations]
    # Friction is a smaller part of a larger load.
    assert errors[3] < errors[1]
    assert errors[5] < errors[3]


def test_the_limits_hold_for_what_is_played_not_for_the_whole_target():
    first = run(linear, settings(iterations=1))[0].drive
    most = 0.8 * np.abs(first).max()
    limits = DriveLimits(
        names=("left", "right"),
        units=("m", "m"),
        minimum=np.full(2, -most),
        maximum=np.full(2, most),
        slew_limit=np.zeros(2),
        sample_rate=SAMPLE_RATE,
    )
    with pytest.raises(DriveLimitError):
        run(linear, settings(iterations=1), limits=limits)
    model = rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))
    target = BAND.limit_target(noise_target(4000))
    half = next(iterate(linear, target, model=model, settings=settings(levels=(0.5, 1.0)), limits=limits))
    np.testing.assert_allclose(half.drive, 0.5 * first)


@pytest.mark.parametrize(
    ("levels", "sentence"),
    [
        ((0.5,), r"levels is \[0.5\]; it must never fall and end with 1"),
        ((0.5, 0.4, 1.0), "it must never fall"),
        ((0.0, 1.0), "levels.0 is 0.0; it must be greater than 0"),
        ((0.5, 1.5), "levels.1 is 1.5; it must be less than or equal to 1"),
        ((float("nan"), 1.0), "levels.0 is nan; it must be a finite number"),
        ((0.1, 0.2, 0.3, 0.4, 1.0), "levels has 4 playbacks below 1 and stop.iterations is 4"),
    ],
)
def test_levels_that_make_no_sense_are_refused(levels, sentence):
    with pytest.raises(ValueError, match=sentence):
        settings(levels=levels)


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("levels", [(), (0.5, 0.75, 1.0)])
def test_recorded_playbacks_are_not_played_and_what_follows_is_the_same_bytes(kind, levels):
    given = settings(kind=kind, levels=levels)
    whole = run(sticking, given)
    played = []

    def plant(drive):
        played.append(drive)
        return sticking(drive)

    recorded = [RecordedPlayback(drive=done.drive, response=done.response) for done in whole[:2]]
    resumed = run(plant, given, recorded=recorded)
    assert len(played) == 2
    for a, b in zip(whole, resumed, strict=True):
        assert a.drive.tobytes() == b.drive.tobytes()
        assert a.response.tobytes() == b.response.tobytes()
        assert a.model.inverse_frf.tobytes() == b.model.inverse_frf.tobytes()
        assert a.outcome is b.outcome


def test_an_end_before_the_last_recorded_playback_does_not_count():
    whole = run(linear, settings())
    recorded = [RecordedPlayback(drive=done.drive, response=done.response) for done in whole[:3]]
    # 0.3 is reached after the second playback already.
    resumed = run(linear, settings(reach=0.3), recorded=recorded)
    assert [iteration.number for iteration in resumed] == [1, 2, 3]
    assert resumed[-1].outcome is not None
