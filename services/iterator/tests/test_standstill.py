"""Which responses are said to stand still: dead sensors are, good ones behind coarse converters and at rest are not."""

import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    CampaignSettings,
    Outcome,
    RecordedPlayback,
    UpdateSettings,
    control_band,
    iterate,
    rig_model,
    run_campaign,
    standstills,
)

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
PERIOD = round(SAMPLE_RATE / BAND.lowest)
H = impulse_responses()


def target(samples=4000):
    return BAND.limit_target(noise_target(samples))


def quantised(response, step):
    return np.round(response / step) * step


def found_in(response, wanted, band=BAND):
    return [
        (found.response, found.segment.start, found.segment.end) for found in standstills(response, wanted, band=band)
    ]


def stuck(response, *, channel=1, first=0, last=None):
    broken = response.copy()
    broken[channel, first:last] = broken[channel, first]
    return broken


@pytest.mark.parametrize("first", [0, 1500, 2400])
def test_a_sensor_that_sticks_is_found_with_the_time(first):
    wanted = target()
    assert found_in(stuck(wanted + 3600.0, first=first), wanted) == [(1, first / SAMPLE_RATE, 4000 / SAMPLE_RATE)]


def test_it_sticks_for_longer_than_a_period_of_the_lower_edge():
    wanted = target()
    assert found_in(stuck(wanted, first=2000, last=2000 + PERIOD + 1), wanted) == []
    assert found_in(stuck(wanted, first=2000, last=2000 + PERIOD + 2), wanted) == [(1, 10.0, 10.51)]


def test_in_a_record_shorter_than_that_period_it_sticks_throughout():
    wanted = np.random.default_rng(0).standard_normal((2, PERIOD // 2))
    assert found_in(stuck(wanted), wanted) == [(1, 0.0, 0.25)]
    assert found_in(stuck(wanted, first=1), wanted) == []


def test_a_good_rig_without_noise_rests_where_its_target_does():
    # The first and the last fifth; the band's filter rings there, which a response as measured need not.
    wanted = target()
    response = wanted.copy()
    response[:, :760], response[:, -760:] = 0.0, 0.0
    assert np.all(wanted[:, :760] != 0.0)
    assert found_in(response, wanted) == []


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("share_of_range", [0.25, 0.01, 0.001])
@pytest.mark.parametrize("reproduced", [1.0, 0.5, 0.1])
@pytest.mark.parametrize(("lowest", "highest"), [(2.0, 60.0), (0.5, 3.0), (20.0, 60.0)])
def test_a_good_response_behind_a_coarse_converter_is_not_found(bits, share_of_range, reproduced, lowest, highest):
    # RMS of the target, of half the range: 128 steps of 10 bits down to half a step, and of that a tenth is measured.
    band = control_band(lowest, highest, sample_rate=SAMPLE_RATE)
    step = 2.0 ** (1 - bits)
    for seed in range(5):
        wanted = band.limit_target(noise_target(12_000, seed=seed, level=(1.0, 1.0)))
        # Loud, then at a tenth, and at rest for a fifth at either end.
        wanted *= np.where(np.arange(12_000) < 6000, 1.0, 0.1) * share_of_range
        wanted /= np.sqrt(np.mean(wanted**2, axis=1, keepdims=True)) / share_of_range
        assert found_in(quantised(reproduced * wanted + 0.3, step), wanted, band) == []


@pytest.mark.parametrize("bits", [10, 12])
def test_a_dead_sensor_behind_a_coarse_converter_is_found(bits):
    wanted = target()
    wanted *= 0.1 / np.sqrt(np.mean(wanted**2, axis=1, keepdims=True))
    response = stuck(quantised(wanted, 2.0 ** (1 - bits)), first=2000)
    ((channel, start, end),) = found_in(response, wanted)
    assert (channel, end) == (1, 20.0)
    assert start == pytest.approx(10.0, abs=0.1)


def test_a_dead_sensor_that_jumps_once_has_no_step_to_hide_behind():
    wanted = target()
    response = wanted.copy()
    response[0] = np.where(np.arange(4000) < 2500, 0.0, -1e5)
    assert found_in(response, wanted) == [(0, 0.0, 12.5)]


def test_records_of_other_instants_are_refused():
    with pytest.raises(ValueError, match=r"the shape \(2, 3999\) and the target \(2, 4000\)"):
        standstills(target()[:, 1:], target(), band=BAND)


def campaign(kind=UpdateKind.BASIC_TWR, weight=None, levels=(), **stop):
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.8), kind=kind),
        stop=StopCriteria(**{"iterations": 6, **stop}),
        levels=levels,
    )
    model = rig_model(*frequency_response(H), identified_band=(1.0, 70.0), response_weight=weight)
    return {"model": model, "settings": settings}


def sticking_from(playback, *, first=1500):
    played = []

    def rig(drive):
        played.append(drive)
        response = play(H, drive) + 500.0
        return stuck(response, first=first) if len(played) >= playback else response

    return rig


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("playback", [1, 3])
def test_a_dead_sensor_ends_the_iteration_before_anything_is_made_of_it(kind, playback):
    result = run_campaign(sticking_from(playback), noise_target(4000), **campaign(kind))
    assert result.outcome is Outcome.RESPONSE_STOOD_STILL
    assert len(result.iterations) == playback
    (found,) = result.iterations[-1].stood_still
    assert (found.response, found.segment.start) == (1, 7.5)
    assert all(iteration.stood_still == () for iteration in result.iterations[:-1])


def test_a_dead_sensor_is_seen_at_partial_level_and_not_judged_as_reached():
    wanted = noise_target(4000)
    low = run_campaign(sticking_from(1), wanted, **campaign(levels=(0.1, 1.0)))
    reached = run_campaign(sticking_from(1, first=2800), wanted, **campaign(relative_rms_error=2.0))
    for result in (low, reached):
        assert (result.outcome, len(result.iterations)) == (Outcome.RESPONSE_STOOD_STILL, 1)


def test_a_coarse_converter_at_partial_level_is_measured_by_the_target_at_that_level():
    # In its quiet half the target moves by some twenty steps, and by half a step at a fiftieth of it.
    wanted = BAND.limit_target(noise_target(4000, level=(1.0, 1.0)))
    wanted *= np.where(np.arange(4000) < 2000, 1.0, 0.18)
    step = np.sqrt(np.mean(wanted**2, axis=1, keepdims=True)) / 30.0
    result = run_campaign(
        lambda drive: quantised(play(H, drive), step), wanted, **campaign(levels=(0.02, 1.0), iterations=2)
    )
    quiet = result.iterations[0].response[:, 2500:3200]
    assert np.all(quiet == quiet[:, :1])
    assert [iteration.stood_still for iteration in result.iterations] == [(), ()]


def test_a_dead_watched_response_is_told_and_ends_nothing():
    h = np.concatenate([H, H[:1] + 30.0 * H[1:]])
    wanted = play(h, BAND.limit_target(noise_target(4000, level=(0.01, 0.02))))
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0), response_weight=np.array([1.0, 1.0, 0.0]))
    update = UpdateSettings(band=BAND, iteration_gain=np.full(3, 0.8), kind=UpdateKind.BASIC_TWR)
    result = run_campaign(
        lambda drive: stuck(play(h, drive), channel=2),
        wanted,
        model=model,
        settings=CampaignSettings(update=update, stop=StopCriteria(iterations=3)),
    )
    assert (result.outcome, len(result.iterations)) == (Outcome.ITERATIONS_USED, 3)
    assert [found.response for iteration in result.iterations for found in iteration.stood_still] == [2, 2, 2]


def test_a_recorded_playback_with_a_dead_sensor_ends_the_iteration_again_without_a_motion():
    first, second = run_campaign(sticking_from(2), noise_target(4000), **campaign()).iterations
    recorded = [RecordedPlayback(drive=step.drive, response=step.response) for step in (first, second)]

    def rests(_drive):
        raise AssertionError("It is not to be played.")

    again = list(iterate(rests, target(), recorded=recorded, **campaign()))
    assert [step.outcome for step in again] == [None, Outcome.RESPONSE_STOOD_STILL]
    # From the playback before, it goes on as if nothing had been.
    gone_on = list(iterate(lambda drive: play(H, drive) + 500.0, target(), recorded=recorded[:1], **campaign()))
    healthy = run_campaign(lambda drive: play(H, drive) + 500.0, noise_target(4000), **campaign())
    assert [step.drive.tobytes() for step in gone_on] == [step.drive.tobytes() for step in healthy.iterations]
