import numpy as np
import pytest

from duralab_proto.v1.array_pb2 import Channel
from duralab_settings import LevelKind, SettingsError, WhitePinkSpectrum
from identifier.excitation import check_levels, pure_random

RATE = 1000.0
PINK = WhitePinkSpectrum(lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0)


def make(rms):
    return pure_random(PINK, rms=rms, samples=60_000, fade_samples=1000, sample_rate=RATE, seed=3)


def limited(**limits):
    return Channel(name="left_vertical", unit="m", **limits)


def test_every_drive_beyond_its_limit_is_named_with_peak_limit_and_a_level_that_fits():
    drive = make(rms=(0.01, 0.02))
    channels = [
        Channel(name="left_vertical", unit="m", minimum=-0.02, maximum=0.02),
        Channel(name="right_vertical", unit="m", minimum=-0.03, maximum=0.5),
    ]
    with pytest.raises(SettingsError) as refusal:
        check_levels(drive, channels=channels, levels=(0.01, 0.02), sample_rate=RATE)
    message = str(refusal.value)
    assert refusal.value.field == "excitation.rms"
    assert "left_vertical would reach" in message
    assert "beyond its limit of" in message
    assert "right_vertical would reach -" in message
    fitting = [float(part.split(" m fits")[0]) for part in message.split("an RMS of ")[1:]]
    assert len(fitting) == 2
    assert 0.9 * 0.01 * 0.02 / np.max(np.abs(drive[0])) < fitting[0] < 0.01
    check_levels(make(rms=fitting), channels=channels, levels=fitting, sample_rate=RATE)


def test_a_drive_inside_its_limits_passes():
    check_levels(make(rms=(0.01,)), channels=[limited(minimum=-0.1, maximum=0.1)], levels=(0.01,), sample_rate=RATE)


def test_a_drive_faster_than_its_slew_limit_is_refused_with_a_level_that_fits():
    drive = make(rms=(0.01,))
    fastest = np.max(np.abs(np.diff(drive))) * RATE
    channel = limited(minimum=-0.1, maximum=0.1, slew_limit=fastest / 2)
    with pytest.raises(SettingsError, match=r"m/s beyond its limit of .* m/s \(an RMS of 0\.00[45]"):
        check_levels(drive, channels=[channel], levels=(0.01,), sample_rate=RATE)
    check_levels(0.499 * drive, channels=[channel], levels=(0.00499,), sample_rate=RATE)


def test_a_limit_that_leaves_no_room_is_refused_without_a_level():
    with pytest.raises(SettingsError, match="no RMS fits"):
        check_levels(make(rms=(0.01,)), channels=[limited(minimum=0.0, maximum=0.1)], levels=(0.01,), sample_rate=RATE)


def test_a_peak_that_would_fit_is_named_where_levels_are_peaks():
    drive = np.array([[0.0, 0.2, -0.1]])
    with pytest.raises(
        SettingsError, match=r"reach 0\.2 m beyond its limit of 0\.1 m \(a peak of 0\.1 m fits\)"
    ) as refusal:
        check_levels(
            drive,
            channels=[limited(minimum=-0.1, maximum=0.1)],
            levels=(0.2,),
            level_kind=LevelKind.PEAK,
            sample_rate=RATE,
        )
    assert refusal.value.field == "excitation.peak"
