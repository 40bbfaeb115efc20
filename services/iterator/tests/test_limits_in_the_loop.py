import numpy as np
import pytest

from duralab_settings import LimitPolicy, StopCriteria, UpdateKind
from iterator import (
    CampaignSettings,
    DriveLimitError,
    DriveLimits,
    Outcome,
    UpdateSettings,
    apply_inverse,
    control_band,
    require_within_limits,
    rig_model,
    run_campaign,
)

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 40.0, sample_rate=SAMPLE_RATE)
H = impulse_responses()


def run(*, peak=np.inf, policy=LimitPolicy.PROJECT, **stop):
    limits = DriveLimits(
        names=("left", "right"),
        units=("m", "m"),
        minimum=np.full(2, -peak),
        maximum=np.full(2, peak),
        slew_limit=np.zeros(2),
        sample_rate=SAMPLE_RATE,
    )
    played = []

    def rig(drive):
        require_within_limits(drive, last_drive=None, limits=limits, iteration_gain=np.ones(2))
        played.append(drive)
        return play(H, drive)

    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.7), kind=UpdateKind.BASIC_TWR),
        stop=StopCriteria(**{"iterations": 6, **stop}),
        limit_policy=policy,
        largest_overrun=2.0,
    )
    model = rig_model(*frequency_response(H), identified_band=(1.0, 60.0))
    target = noise_target(4000)
    target[:, 1500:1700] *= 4.0
    return run_campaign(rig, target, model=model, settings=settings, limits=limits), played


def largest_drive():
    result, _ = run()
    assert all(iteration.projection.passings == () for iteration in result.iterations)
    return np.abs(result.iterations[-1].drive).max(axis=1).max()


def test_a_target_beyond_the_rig_is_played_as_far_as_it_can_and_flagged_where_it_cannot():
    # The rig of this test refuses what is beyond its limits, as a real one does.
    result, played = run(peak=0.6 * largest_drive())
    last = result.iterations[-1]
    assert len(played) == 6
    np.testing.assert_array_equal(last.drive, played[-1])
    assert last.projection.passings
    assert last.unreachable
    # Samples 1500 to 1700 are 7.5 to 8.5 s; an error counts over a window of a second, and the band rings a little.
    assert all(found.segment.start > 6.0 and found.segment.end < 10.0 for found in last.unreachable)
    quiet = slice(2600, None)
    error = (result.target_in_band - last.response_in_band)[:, quiet].std(axis=1)
    assert np.all(error < 0.02 * result.target_in_band[:, quiet].std(axis=1))


def test_a_drive_beyond_the_limits_is_refused_where_that_is_the_policy():
    with pytest.raises(DriveLimitError, match="past the rig's limit"):
        run(peak=0.6 * largest_drive(), policy=LimitPolicy.REFUSE)


def test_after_a_roll_back_the_gain_that_would_fit_counts_from_the_drive_stepped_from():
    """Shares of the target's drive: 0.5 is kept, 0.75 left as worse, then half of 1 is added, past a limit of 0.9."""
    model = rig_model(*frequency_response(H), identified_band=(1.0, 60.0))
    target = BAND.limit_target(noise_target(4000))
    whole = np.abs(apply_inverse(model, target, band=BAND)).max(axis=1)
    limits = DriveLimits(("left", "right"), ("m", "m"), -0.9 * whole, 0.9 * whole, np.zeros(2), SAMPLE_RATE)
    responses = iter((1e-9 * target, -target))
    update = UpdateSettings(
        band=BAND,
        iteration_gain=np.ones(2),
        kind=UpdateKind.BASIC_TWR,
        accept_segments=True,
        gain_schedule=(0.5, 0.25, 1.0),
    )
    settings = CampaignSettings(update=update, stop=StopCriteria(iterations=6))
    with pytest.raises(DriveLimitError) as refused:
        run_campaign(lambda _: next(responses), noise_target(4000), model=model, settings=settings, limits=limits)
    assert refused.value.fitting_share == pytest.approx(0.8, rel=1e-3)


def test_a_damage_budget_ends_the_iteration_before_it_is_passed():
    result, _ = run(damage_budget=2.5)
    assert result.outcome is Outcome.DAMAGE_BUDGET_USED
    spent = sum(iteration.metrics.specimen_damage[:, 1] for iteration in result.iterations)
    assert np.all(spent <= 2.5)
    assert np.any(spent + 1.0 > 2.5)


def test_an_iteration_that_the_rig_holds_up_ends_for_no_more_improvement():
    result, _ = run(peak=0.5 * largest_drive(), iterations=20, smallest_improvement=0.02)
    assert result.outcome is Outcome.NO_IMPROVEMENT
    assert len(result.iterations) < 20
