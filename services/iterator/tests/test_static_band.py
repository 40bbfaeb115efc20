"""A control band from 0 Hz: means and slow parts on a linear plant, what holds them, and what is refused."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, identifier_pb2, query_pb2
from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    CampaignSettings,
    DriveLimits,
    ModelUncertainty,
    UpdateSettings,
    apply_inverse,
    control_band,
    iterate,
    project_drive,
    rig_model,
)
from iterator.assessment import standstills
from iterator.campaign import checked_model, plan_campaign
from iterator.campaign.static_part import require_settled

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play
from .linear_rig import STATIC, description, exact_model, experiment_plan, specification

H = impulse_responses()
SAMPLES = 8001
BAND = control_band(0.0, 60.0, sample_rate=SAMPLE_RATE, static_response=STATIC)
TIME = np.arange(SAMPLES) / SAMPLE_RATE


def ramp(start, end):
    return np.clip((TIME - start) / (end - start), 0.0, 1.0)


def manoeuvre():
    """Holds of 5 s far above the noise on them, on what the rig carries at rest."""
    braking, turning = ramp(8, 9) - ramp(14, 15), ramp(18, 19) - 2.0 * ramp(22, 24) + ramp(28, 29)
    return np.array([3000.0 * braking + 200.0 * turning, 120.0 * turning])


def target():
    return STATIC[:, None] + manoeuvre() + noise_target(SAMPLES, level=(300.0, 12.0))


def model(*, share=1.0, lowest=1.0):
    """The exact FRF from `lowest` on, and a share of the exact static gain."""
    frequency, frf = frequency_response(H)
    frf[(frequency < lowest) | (frequency > 70.0)] = 0.0
    uncertainty = ModelUncertainty(
        residual_psd=np.full((frequency.size, 2), 1e-3),
        row_covariance=np.tile(np.diag([1e2, 1e1]).astype(complex), (frequency.size, 1, 1)),
    )
    return rig_model(
        frequency, frf, identified_band=(lowest, 70.0), uncertainty=uncertainty, static_gain=share * H.sum(axis=2)
    )


def campaign(kind, gain, *, iterations, share=1.0, **more):
    accepts = kind is UpdateKind.SECANT
    update = UpdateSettings(band=BAND, kind=kind, iteration_gain=(gain, gain), accept_segments=accepts)
    settings = CampaignSettings(update=update, stop=StopCriteria(iterations=iterations), **more)
    return list(
        iterate(
            lambda drive: play(H, drive) + STATIC[:, None],
            BAND.limit_target(target()),
            model=model(share=share),
            settings=settings,
        )
    )


def slow_part(record):
    lines = np.fft.rfft(record, 16384)
    return np.fft.irfft(lines * (np.fft.rfftfreq(16384, 1.0 / SAMPLE_RATE) < 1.0), 16384)


def test_the_target_counts_from_the_static_response_and_keeps_mean_and_drift():
    steady = STATIC[:, None] + np.array([[500.0], [-7.0]]) * np.ones(SAMPLES)
    limited = BAND.limit_target(steady)
    inside = slice(200, -200)
    np.testing.assert_allclose(limited[:, inside], (steady - STATIC[:, None])[:, inside], rtol=1e-3)
    np.testing.assert_allclose(limited[:, [0, -1]], 0.0, atol=5.0)
    assert np.max(np.abs(BAND.limit_response(STATIC[:, None] * np.ones(SAMPLES)))) < 1e-9


@pytest.mark.parametrize("gain", [0.5, 0.8])
def test_means_and_slow_parts_shrink_with_all_the_rest_by_one_minus_the_gain(gain):
    wanted = BAND.limit_target(target())
    for iteration in campaign(UpdateKind.BASIC_TWR, gain, iterations=5):
        left, error = (1.0 - gain) ** iteration.number, wanted - iteration.response_in_band
        np.testing.assert_allclose(iteration.metrics.relative_rms_error, left, rtol=0.02, atol=1e-3)
        slow = np.sqrt(np.sum(slow_part(error) ** 2, axis=1) / np.sum(slow_part(wanted) ** 2, axis=1))
        np.testing.assert_allclose(slow, left, rtol=0.02, atol=1e-3)
        assert abs(error.mean(axis=1) / wanted.mean(axis=1))[0] == pytest.approx(left, rel=0.02, abs=1e-3)


def test_drives_begin_and_end_at_rest_and_hold_the_manoeuvre_between():
    best = campaign(UpdateKind.BASIC_TWR, 1.0, iterations=2)[-1]
    assert np.all(best.drive[:, [0, -1]] == 0.0)
    held = (TIME > 10.0) & (TIME < 13.5)
    expected = np.linalg.solve(H.sum(axis=2), manoeuvre()[:, held].mean(axis=1))
    np.testing.assert_allclose(best.drive[:, held].mean(axis=1), expected, rtol=0.02, atol=2e-4)


def test_the_secant_update_learns_a_static_gain_that_was_not_settled():
    errors = [
        iteration.metrics.overall_relative_rms_error
        for iteration in campaign(UpdateKind.SECANT, 1.0, iterations=5, share=0.7)
    ]
    assert errors[0] > 0.2
    assert errors[-1] < 1e-3


def test_partial_levels_count_from_the_static_response():
    first = campaign(UpdateKind.BASIC_TWR, 1.0, iterations=2, levels=(0.5, 1.0))[0]
    assert first.metrics.overall_relative_rms_error < 2e-3
    assert np.max(np.abs(first.response - STATIC[:, None])) < 0.6 * np.max(np.abs(BAND.limit_target(target())))


def test_a_drive_whose_slow_part_passes_a_limit_is_carried_to_it_without_corners():
    hold = 0.12 * (ramp(8, 9) - ramp(14, 15))
    drive = np.array([hold, 0.5 * hold])
    limits = DriveLimits(
        names=("left", "right"),
        units=("m", "m"),
        minimum=np.full(2, -0.1),
        maximum=np.full(2, 0.1),
        slew_limit=np.zeros(2),
        sample_rate=SAMPLE_RATE,
    )
    projection = project_drive(drive, limits=limits, band=BAND)
    assert projection.drive[0].max() <= 0.1
    assert projection.drive[0, (TIME > 10) & (TIME < 13)].mean() > 0.099
    assert projection.clipped[0] < 1e-3
    np.testing.assert_array_equal(projection.drive[1], drive[1])


def test_a_dead_sensor_is_found_while_the_target_moves_slowly():
    response = np.full((2, SAMPLES), 3.0)
    found = standstills(response, BAND.limit_target(STATIC[:, None] + manoeuvre()), band=BAND)
    assert [still.response for still in found] == [0, 1]


def test_a_model_without_a_static_gain_is_refused_for_a_band_from_0():
    frequency, frf = frequency_response(H)
    bare = rig_model(frequency, frf, identified_band=(0.5 * frequency[1], 70.0))
    with pytest.raises(ValueError, match=r"static_gain, or control a band above it\."):
        apply_inverse(bare, np.zeros((2, 4000)), band=BAND)
    for wrong in (np.ones((2, 3)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match=r"must be \(2, 2\) like a line of the FRF, and finite\."):
            rig_model(frequency, frf, identified_band=(1.0, 70.0), static_gain=wrong)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"static_response": None}, r"The static response is not given for a control band from 0 Hz"),
        ({"lowest": 1.0}, r"The static response is given for a control band from 1 Hz"),
        ({"lower_flank": 0.2}, r"there is no room for one, leave it out\."),
        ({"lowest": -1.0}, r"it must lie from 0 up to half the sample rate"),
        ({"excited": (0.5, 70.0)}, r"it must lie in the excited band, which begins at 0\.5 Hz"),
    ],
)
def test_a_band_that_does_not_fit_0_is_refused(changes, sentence):
    given = {"lowest": 0.0, "sample_rate": SAMPLE_RATE, "static_response": STATIC, **changes}
    with pytest.raises(ValueError, match=sentence):
        control_band(given.pop("lowest"), 60.0, **given)


def test_a_record_of_other_channels_than_the_static_response_is_refused():
    with pytest.raises(
        ValueError, match=r"The record has 3 channels; the control band from 0 Hz has the static response of 2\."
    ):
        BAND.limit_response(np.zeros((3, 100)))


def static_campaign():
    """A campaign from 0 Hz on a rig that allows it."""
    spec, rig = specification(), description()
    spec.lowest_frequency, spec.excitation.static_hold = 0.0, 4.0
    for drive in rig.drives:
        drive.holds_static = True
    return spec, rig


def test_a_campaign_from_0_is_planned_with_the_rest_of_the_rig_and_says_where_the_target_is_not_at_rest():
    spec, rig = static_campaign()
    plan = plan_campaign(spec, rig, experiment_plan(spec))
    offset = from_array(spec.target.samples)[:, 0] - STATIC
    np.testing.assert_allclose(plan.target_in_band[:, 200:1000].mean(axis=1), offset, rtol=0.05)
    assert plan.target_energy_outside_band.max() < 0.5
    begins, ends = (remark for remark in plan.remarks if "static response" in remark)
    assert "within 0.25 s to -3100 N in left_vertical, +480 N in right_vertical." in begins
    assert "within 0.25 s from -3100 N in left_vertical" in ends


@pytest.mark.parametrize(
    ("change", "field", "code", "sentence"),
    [
        (
            lambda spec, rig: setattr(rig.drives[1], "holds_static", False),
            "lowest_frequency",
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            "does not state that it holds a constant right,",
        ),
        (
            lambda spec, rig: setattr(rig.responses[0], "ac_coupled", True),
            "lowest_frequency",
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            "the response left_vertical of rig 'front' is AC-coupled and measures no constant value",
        ),
        (
            lambda spec, rig: setattr(rig.responses[1], "kind", array_pb2.CHANNEL_KIND_ACCELERATION),
            "lowest_frequency",
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            "the response right_vertical of rig 'front' is an acceleration, which is 0 at rest",
        ),
        (
            lambda spec, rig: setattr(spec.excitation, "static_hold", 0.0),
            "excitation.static_hold",
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            "the excitation has static_hold 0, so that the static gain would not be measured",
        ),
    ],
)
def test_a_rig_or_a_campaign_that_cannot_hold_a_static_part_is_refused_with_reason_and_remedy(
    change, field, code, sentence
):
    spec, rig = static_campaign()
    change(spec, rig)
    with pytest.raises(FaultError) as caught:
        plan_campaign(spec, rig, experiment_plan(spec))
    assert (caught.value.field, caught.value.code) == (field, code)
    assert sentence in caught.value.message
    assert ". " not in caught.value.message.replace("e.g. ", "")


def test_what_a_rig_cannot_hold_is_no_matter_of_a_band_above_0():
    spec, rig = specification(), description()
    rig.responses[0].ac_coupled = True
    assert plan_campaign(spec, rig, experiment_plan(spec)).settings.update.band.static_response is None


def test_a_watched_response_may_be_ac_coupled():
    spec, rig = static_campaign()
    third = array_pb2.Channel(name="acceleration", unit="m/s^2", kind=array_pb2.CHANNEL_KIND_ACCELERATION)
    third.minimum, third.maximum, third.ac_coupled = -1e3, 1e3, True
    rig.responses.append(third)
    rig.static_response.CopyFrom(to_array(np.append(STATIC, 0.0)))
    spec.target.channels.append(third)
    samples = from_array(spec.target.samples)
    spec.target.samples.CopyFrom(to_array(np.vstack([samples, np.zeros(samples.shape[1])])))
    spec.update.iteration_gain.CopyFrom(to_array(np.array([0.5, 0.5, 0.5])))
    spec.update.weights.CopyFrom(to_array(np.array([1.0, 1.0, 0.0])))
    assert plan_campaign(spec, rig, experiment_plan(spec)).settings.update.band.lowest == 0.0


@pytest.mark.parametrize("change", [None, [0.0, 0.3], [0.31, 0.0], [0.05, 1.0], [np.nan, 0.0]])
def test_a_band_from_0_is_refused_where_a_response_did_not_come_to_rest_in_the_holds(change):
    spec, rig = static_campaign()
    plan = plan_campaign(spec, rig, experiment_plan(spec))
    model = exact_model(identifier_pb2.IdentifyRequest(rig=spec.rig, run="one", estimator=spec.estimator))
    model.static_gain.CopyFrom(to_array(H.sum(axis=2)))
    if change is not None:
        model.static_change.CopyFrom(to_array(np.array(change)))
    if change is None or max(change) <= 0.3:
        assert checked_model(model, plan=plan).frf.shape[1:] == (2, 2)
        return
    with pytest.raises(FaultError) as caught:
        checked_model(model, plan=plan)
    if not np.isfinite(change).all():
        assert "damaged model" in caught.value.message
        return
    moving = "left_vertical by 31 %" if change[0] > 0.3 else "right_vertical by 100 %"
    assert (caught.value.field, caught.value.code) == ("lowest_frequency", query_pb2.FAULT_CODE_FAILED_PRECONDITION)
    said = f"while each drive was held for 4 s: {moving} of the step in the second half, and 30 % is allowed"
    assert said in caught.value.message
    assert "hold the drives longer (excitation.static_hold)" in caught.value.message
    # A watched response may move.
    require_settled(model, spec=spec, description=rig, controlled=np.array(change) <= 0.3)
