import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iterator import DriveLimits, LimitQuantity, control_band, project_drive, require_within_limits

RATE = 256.0
BAND = control_band(1.5, 27.0, sample_rate=RATE, lower_flank=0.5, upper_flank=3.0)
OUTSIDE = 31.0


def limits(peak=np.inf, slew=0.0, channels=2):
    return DriveLimits(
        names=("left", "right")[:channels],
        units=("m",) * channels,
        minimum=np.full(channels, -0.8 * peak),
        maximum=np.full(channels, peak),
        slew_limit=np.full(channels, slew),
        sample_rate=RATE,
    )


def drive(samples=6000, *, seed=0):
    """Noise of RMS 1 in the band, at rest at both ends."""
    position = np.linspace(0.0, 1.0, samples)
    envelope = np.clip(5.0 * np.minimum(position, 1.0 - position) - 0.5, 0.0, 1.0)
    noise = BAND.limit_response(np.random.default_rng(seed).standard_normal((2, samples)) * envelope)
    return noise / noise.std(axis=1, keepdims=True)


def fits(values, allowed):
    require_within_limits(values, last_drive=None, limits=allowed, iteration_gain=np.ones(1))


def energy_outside(values):
    spectrum = np.abs(np.fft.rfft(values)) ** 2
    return float(spectrum[:, np.fft.rfftfreq(values.shape[1], 1.0 / RATE) > OUTSIDE].sum())


def test_a_drive_that_fits_is_left_to_the_last_bit_and_nothing_is_reported():
    given_drive = drive()
    projection = project_drive(given_drive, limits=limits(peak=100.0, slew=1e4), band=BAND)
    np.testing.assert_array_equal(projection.drive, given_drive)
    assert projection.passings == ()
    assert not projection.saturated.any()
    np.testing.assert_array_equal(projection.change, 0.0)


@pytest.mark.parametrize(("peak", "slew"), [(2.5, 0.0), (1.2, 0.0), (np.inf, 150.0), (2.0, 90.0)])
def test_peak_and_slew_hold_exactly_and_the_change_stays_in_the_band(peak, slew):
    given_drive, allowed = drive(), limits(peak, slew)
    projection = project_drive(given_drive, limits=allowed, band=BAND)
    fits(projection.drive, allowed)
    assert projection.passings
    np.testing.assert_array_equal(projection.clipped, 0.0)
    clipped = np.clip(given_drive, allowed.minimum[:, None], allowed.maximum[:, None])
    if slew == 0.0:
        assert energy_outside(projection.drive - given_drive) < 1e-4 * energy_outside(clipped - given_drive)
    # Never further from the drive than playing nothing at all, and no other than asked for.
    assert np.all((projection.change > 0.0) & (projection.change < 0.6))


def test_only_the_channel_and_the_time_that_pass_are_changed_much():
    values = drive(samples=9000)
    values[:, 2000:] *= 0.2
    values[1] *= 0.1
    projection = project_drive(values, limits=limits(peak=1.5), band=BAND)
    np.testing.assert_array_equal(projection.drive[1], values[1])
    change = np.abs(projection.drive[0] - values[0])
    assert change[5000:].max() < 0.01 * change.max()
    assert {passing.channel for passing in projection.passings} == {"left"}
    assert projection.passings[0].segments[-1].end <= 2000.0 / RATE


def test_the_report_says_channel_quantity_excess_share_and_when():
    values = np.zeros((2, 2560))
    values[0] = 1.0 * np.sin(2.0 * np.pi * 5.0 * np.arange(2560) / RATE)
    values[0, :256] = values[0, -256:] = 0.0
    values[0, 1280:1536] *= 1.5
    allowed = limits(peak=1.25)
    passing = project_drive(values, limits=allowed, band=BAND).passings
    peak = max(passing, key=lambda found: found.largest_excess)
    assert (peak.channel, peak.unit, peak.quantity) == ("left", "m", LimitQuantity.PEAK)
    # The lower limit is 0.8 of the upper one and is passed furthest.
    assert peak.limit == pytest.approx(1.0)
    assert peak.largest_excess == pytest.approx(0.5, abs=0.01)
    assert len(peak.segments) == 1
    assert (peak.segments[0].start, peak.segments[0].end) == pytest.approx((5.0, 6.0), abs=0.2)
    past = (values[0] > 1.25) | (values[0] < -1.0)
    assert peak.share_of_time == pytest.approx(past.mean())
    for word in ("left", "peak limit of 1 m", "by 0.5 m", "first at 5."):
        assert word in str(peak)


def test_what_no_change_in_the_band_can_mend_is_clipped_and_said():
    # A step of 50 Hz content and a jump at the start lie outside the band.
    time = np.arange(2000) / RATE
    values = np.vstack([2.0 * np.cos(2.0 * np.pi * 50.0 * time), np.zeros(2000)])
    allowed = limits(peak=1.0, slew=100.0)
    projection = project_drive(values, limits=allowed, band=BAND)
    fits(projection.drive, allowed)
    assert projection.clipped[0] > 0.1
    assert projection.clipped[1] == 0.0
    assert {passing.quantity for passing in projection.passings} == {LimitQuantity.PEAK, LimitQuantity.SLEW}


@settings(max_examples=20)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=40),
    st.floats(0.01, 100.0),
    st.floats(0.1, 1e4),
)
def test_any_drive_ends_within_the_limits(values, peak, slew):
    allowed = limits(peak, slew, channels=1)
    fits(project_drive(np.array([values]), limits=allowed, band=BAND).drive, allowed)


def test_projecting_twice_changes_nothing_more():
    allowed = limits(1.5, 120.0)
    once = project_drive(drive(), limits=allowed, band=BAND).drive
    again = project_drive(once, limits=allowed, band=BAND)
    np.testing.assert_array_equal(again.drive, once)
    assert again.passings == ()


def test_a_drive_of_other_channels_is_refused():
    with pytest.raises(ValueError, match="1 channels; the rig has 2"):
        project_drive(np.zeros((1, 10)), limits=limits(1.0), band=BAND)
