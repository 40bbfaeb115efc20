"""Nothing is played that the target, the rig or the model's own prediction speak against."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_settings import LimitPolicy, StopCriteria, UpdateKind
from iterator import (
    NO_BOUNDS,
    BoundedQuantity,
    CampaignSettings,
    DriveLimits,
    DriveOverrunError,
    NextDrive,
    Outcome,
    PlaybackBoundError,
    UpdateSettings,
    apply_inverse,
    control_band,
    judge_response,
    rig_model,
    run_campaign,
)
from iterator.assessment import passed_bound
from iterator.campaign import plan_campaign

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play
from .linear_rig import description, experiment_plan, specification

BAND = control_band(2.0, 40.0, sample_rate=SAMPLE_RATE)
H = impulse_responses()
TARGET = BAND.limit_target(noise_target(4000))


def run(rig, *, bounds=None, gain=0.7, levels=(), limits=None, overrun=1.25, model_scale=1.0, weight=None):
    played = []

    def counted(drive):
        played.append(drive)
        return rig(drive)

    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=UpdateKind.BASIC_TWR),
        stop=StopCriteria(iterations=6, **(bounds or {})),
        levels=levels,
        limit_policy=LimitPolicy.PROJECT,
        largest_overrun=overrun,
    )
    frequency, frf = frequency_response(H)
    model = rig_model(frequency, frf * model_scale, identified_band=(1.0, 60.0), response_weight=weight)
    try:
        return run_campaign(counted, TARGET, model=model, settings=settings, limits=limits), played
    except (PlaybackBoundError, DriveOverrunError) as error:
        return error, played


def limits(peak, slew=0.0):
    return DriveLimits(
        ("left", "right"), ("m", "m"), np.full(2, -peak), np.full(2, peak), np.full(2, slew), SAMPLE_RATE
    )


def louder(factor, row=0):
    def rig(drive):
        response = play(H, drive)
        response[row] *= factor
        return response

    return rig


def test_a_playback_beyond_a_bound_ends_the_campaign_and_names_response_and_value():
    result, played = run(louder(6.0))
    assert (result.outcome, len(played)) == (Outcome.BOUND_PASSED, 1)
    found = result.iterations[-1].passed_bound
    # 0.7 of the target, six times: damage grows with the fifth power.
    assert (found.response, found.quantity) == (0, BoundedQuantity.DAMAGE)
    assert found.value == pytest.approx(4.2**5, rel=0.02)
    assert "damage over the target's of left_vertical is" in found.sentence("left_vertical")


@pytest.mark.parametrize(
    ("bounds", "quantity"),
    [
        ({**NO_BOUNDS, "error_bound": 2.5}, BoundedQuantity.ERROR),
        ({**NO_BOUNDS, "peak_bound": 2.5}, BoundedQuantity.PEAK),
        ({**NO_BOUNDS, "damage_bound": 100.0}, BoundedQuantity.DAMAGE),
    ],
)
def test_each_bound_ends_a_campaign_alone(bounds, quantity):
    result, _ = run(louder(6.0), bounds=bounds)
    assert result.iterations[-1].passed_bound.quantity is quantity


def test_a_partial_level_is_bounded_by_the_whole_target():
    # Four times too loud at a quarter of the target is the target.
    result, _ = run(louder(4.0), levels=(0.25, 1.0), gain=1.0)
    assert result.iterations[0].passed_bound is None
    assert result.outcome is not Outcome.REACHED


def test_a_watched_response_passes_no_bound():
    frequency, frf = frequency_response(H)
    model = rig_model(
        frequency, np.concatenate([frf, frf[:, :1]], axis=1), identified_band=(1.0, 60.0), response_weight=[1, 1, 0]
    )
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(3, 0.7), kind=UpdateKind.BASIC_TWR),
        stop=StopCriteria(iterations=3),
    )
    three = np.vstack([TARGET, 1e-3 * TARGET[:1]])
    result = run_campaign(lambda u: play(H, u)[[0, 1, 0]], three, model=model, settings=settings)
    assert result.outcome is Outcome.ITERATIONS_USED


def test_a_drive_whose_prediction_passes_a_bound_is_not_played():
    played = []

    def rig(drive):
        played.append(drive)
        return play(H, drive)

    def quadrupling(history, model, settings):
        """An update of somebody's own that runs away."""
        if not history.playbacks:
            return NextDrive(drive=apply_inverse(model, history.target, band=settings.band), model=model)
        return NextDrive(drive=4.0 * history.playbacks[-1].drive, model=model)

    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, 1.0)), stop=StopCriteria(iterations=6)
    )
    model = rig_model(*frequency_response(H), identified_band=(1.0, 60.0))
    with pytest.raises(PlaybackBoundError, match="Playback 2 is not played: by the model's prediction") as caught:
        run_campaign(rig, TARGET, model=model, settings=settings, update=quadrupling)
    assert len(played) == 1
    assert (caught.value.passed.quantity, caught.value.passed.value) == (
        BoundedQuantity.DAMAGE,
        pytest.approx(4.0**5, rel=0.01),
    )


def test_a_first_drive_far_beyond_a_limit_is_refused_before_anything_is_played():
    largest = max(float(np.abs(drive).max()) for drive in run(louder(1.0))[1][:1])
    error, played = run(louder(1.0), limits=limits(largest / 2.0))
    assert isinstance(error, DriveOverrunError)
    assert played == []
    assert "2 times the rig's limit" in str(error)
    result, _ = run(louder(1.0), limits=limits(largest / 2.0), overrun=2.1)
    assert result.iterations[0].projection.passings
    # A slew counts as well.
    error, played = run(louder(1.0), limits=limits(10.0, slew=1e-6))
    assert "slew" in str(error)
    assert played == []


def test_a_first_drive_at_partial_level_is_refused_for_the_whole_target():
    largest = float(np.abs(run(louder(1.0))[1][0]).max())
    error, played = run(louder(1.0), limits=limits(largest / 2.0), levels=(0.25, 1.0))
    assert isinstance(error, DriveOverrunError)
    assert played == []


@pytest.mark.parametrize("kwargs", [{"error_bound": 1.0}, {"peak_bound": 0.0}, {"damage_bound": np.nan}])
def test_a_bound_that_the_target_itself_passes_is_refused(kwargs):
    with pytest.raises(ValueError, match=r"must be (greater than 1|a finite number)"):
        StopCriteria(iterations=3, **kwargs)


def test_the_bound_passed_furthest_is_named():
    judged = judge_response(TARGET, np.array([[1.5], [4.0]]) * TARGET)
    found = passed_bound(judged, StopCriteria(iterations=3, damage_bound=1e9), level=1.0)
    assert (found.response, found.quantity) == (1, BoundedQuantity.PEAK)
    assert passed_bound(judge_response(TARGET, TARGET), StopCriteria(iterations=3), level=1.0) is None


def planned(*, range=1e5, watchdog=0.0, unit=""):
    spec, rig = specification(), description()
    if unit:
        spec.target_steps.add(name="read_file").channels.add(channel="left_vertical", source="Fz FL", stated_unit=unit)
    for channel in rig.responses:
        channel.minimum, channel.maximum, channel.watchdog = -range, range, watchdog
    return plan_campaign(spec, rig, experiment_plan(spec))


def test_a_target_beyond_the_range_or_watchdog_of_a_response_is_refused_with_the_multiple():
    # At rest 3600 N; the target swings by 1.5 to 2 kN around it.
    planned()
    with pytest.raises(FaultError, match=r"left_vertical peaks at .* times the 3e\+03 N of its range") as caught:
        planned(range=3000.0)
    assert caught.value.field == "target.samples"
    with pytest.raises(FaultError, match=r"times the 4e\+03 N of its watchdog .* unit, scale and channel right\?"):
        planned(watchdog=4000.0)
    with pytest.raises(FaultError, match=r"is `unit: kN` right for the file's channel 'Fz FL'\?"):
        planned(watchdog=4000.0, unit="kN")


def test_a_target_far_below_the_range_of_a_response_is_told_of():
    assert not any("unit and scale" in remark for remark in planned(range=1e5).remarks)
    (remark,) = [remark for remark in planned(range=1e8).remarks if "unit and scale" in remark]
    assert "left_vertical" in remark


def test_drives_begin_and_end_at_rest_however_often_they_are_corrected():
    # A target in motion at both ends, and a rig that starts there from rest.
    target = np.random.default_rng(5).standard_normal((2, 4000)) * np.array([[900.0], [40.0]])
    settings = CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.9), kind=UpdateKind.SECANT),
        stop=StopCriteria(iterations=10),
    )
    model = rig_model(*frequency_response(H), identified_band=(1.0, 60.0))
    result = run_campaign(lambda u: play(H, u), target, model=model, settings=settings)
    for iteration in result.iterations:
        np.testing.assert_array_equal(iteration.drive[:, [0, -1]], 0.0)
    # What the faded ends leave: nothing grows there, and the rest is reproduced.
    assert result.iterations[-1].metrics.overall_relative_rms_error < 0.02
