import numpy as np
import pytest

import spectra
from duralab_proto.v1.array_pb2 import Channel
from identifier import SettingError, WhitePink, check_levels, pure_random

RATE = 1000.0
PINK = WhitePink(lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0)


def make(samples=60_000, fade=1000, rms=(0.01, 0.02, 0.5), seed=3, spectrum=PINK):
    return pure_random(spectrum, rms=rms, samples=samples, fade_samples=fade, sample_rate=RATE, seed=seed)


def test_the_rms_between_the_fades_is_exact():
    np.testing.assert_allclose(spectra.rms(make()[:, 1000:-1000]), [0.01, 0.02, 0.5], rtol=1e-14)


@pytest.mark.parametrize("samples", [60_000, 60_001, 59_999])
def test_hardly_anything_lies_outside_the_band(samples):
    drive = make(samples=samples)
    frequency = np.fft.rfftfreq(samples, 1 / RATE)
    power = np.abs(np.fft.rfft(drive, axis=1)) ** 2
    share = power / power.sum(axis=1, keepdims=True)
    # Only the fades reach out of the band, by about one over their length: nothing else below, next to nothing above.
    assert np.all(share[:, frequency < 0.45].sum(axis=1) < 5e-4)
    assert np.all(share[:, frequency > 50.5].sum(axis=1) < 1e-6)
    assert np.all(share[:, frequency > 70.0].sum(axis=1) < 1e-9)


def test_without_fades_nothing_at_all_lies_outside_the_band():
    power = np.abs(np.fft.rfft(make(fade=0), axis=1)) ** 2
    frequency = np.fft.rfftfreq(60_000, 1 / RATE)
    outside = power[:, (frequency < 0.5 - 1e-9) | (frequency > 50.0 + 1e-9)].sum(axis=1)
    assert np.all(outside < 1e-28 * power.sum(axis=1))


def test_the_psd_is_flat_to_the_corner_and_falls_by_the_slope_above():
    drive = make(samples=1_200_000, fade=0, rms=(1.0,))
    density = spectra.auto_spectra(drive, block_samples=4096, overlap=0.5, sample_rate=RATE)[:, 0]
    frequency = spectra.line_frequencies(4096, RATE)

    def level(low, high):
        return 10 * np.log10(np.mean(density[(frequency >= low) & (frequency <= high)]))

    assert level(1.0, 2.5) == pytest.approx(level(2.5, 4.8), abs=0.4)
    # Two octaves above one another, around 10 and 40 Hz: 12 dB.
    assert level(9.5, 10.5) - level(38.0, 42.0) == pytest.approx(12.0, abs=0.4)


def test_a_slope_of_zero_is_white():
    white = WhitePink(lowest_frequency=1.0, highest_frequency=100.0, corner_frequency=1.0, decibels_per_octave=0.0)
    np.testing.assert_array_equal(white.density(np.array([0.5, 1.0, 30.0, 100.0, 101.0])), [0.0, 1.0, 1.0, 1.0, 0.0])


def test_drives_are_independent_and_gaussian():
    drive = make(samples=200_000, fade=0, rms=(1.0, 1.0, 1.0))
    correlation = np.corrcoef(drive)
    assert np.max(np.abs(correlation - np.eye(3))) < 0.05
    np.testing.assert_allclose(np.mean(drive**4, axis=1), 3.0, rtol=0.1)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    assert make().tobytes() == make().tobytes()
    assert make(seed=4).tobytes() != make().tobytes()


def test_the_stream_of_a_drive_does_not_depend_on_how_many_there_are():
    np.testing.assert_array_equal(make(rms=(0.01,))[0], make(rms=(0.01, 0.02, 0.5))[0])


def test_the_fades_are_linear_from_and_to_zero():
    faded, plain = make(), make(fade=0)
    ratio = (faded / plain)[0]
    factor = ratio[30_000]
    np.testing.assert_allclose(ratio[:1000] / factor, np.arange(1000) / 1000, rtol=1e-9)
    np.testing.assert_allclose(ratio[-1000:] / factor, np.arange(1000)[::-1] / 1000, rtol=1e-9)


def limited(**limits):
    return Channel(name="left_vertical", unit="m", **limits)


def test_every_drive_beyond_its_limit_is_named_with_peak_limit_and_a_level_that_fits():
    drive = make(rms=(0.01, 0.02))
    channels = [
        Channel(name="left_vertical", unit="m", minimum=-0.02, maximum=0.02),
        Channel(name="right_vertical", unit="m", minimum=-0.03, maximum=0.5),
    ]
    with pytest.raises(SettingError) as refusal:
        check_levels(drive, channels=channels, rms=(0.01, 0.02), sample_rate=RATE)
    message = str(refusal.value)
    assert refusal.value.field == "excitation.rms"
    assert "left_vertical would reach" in message
    assert "beyond its limit of" in message
    assert "right_vertical would reach -" in message
    fitting = [float(part.split(" m fits")[0]) for part in message.split("an RMS of ")[1:]]
    assert len(fitting) == 2
    assert 0.9 * 0.01 * 0.02 / np.max(np.abs(drive[0])) < fitting[0] < 0.01
    check_levels(make(rms=fitting), channels=channels, rms=fitting, sample_rate=RATE)


def test_a_drive_inside_its_limits_passes():
    check_levels(make(rms=(0.01,)), channels=[limited(minimum=-0.1, maximum=0.1)], rms=(0.01,), sample_rate=RATE)


def test_a_drive_faster_than_its_slew_limit_is_refused_with_a_level_that_fits():
    drive = make(rms=(0.01,))
    fastest = np.max(np.abs(np.diff(drive))) * RATE
    channel = limited(minimum=-0.1, maximum=0.1, slew_limit=fastest / 2)
    with pytest.raises(SettingError, match=r"m/s beyond its limit of .* m/s \(an RMS of 0\.00[45]"):
        check_levels(drive, channels=[channel], rms=(0.01,), sample_rate=RATE)
    check_levels(0.499 * drive, channels=[channel], rms=(0.00499,), sample_rate=RATE)


def test_a_limit_that_leaves_no_room_is_refused_without_a_level():
    with pytest.raises(SettingError, match="no RMS fits"):
        check_levels(make(rms=(0.01,)), channels=[limited(minimum=0.0, maximum=0.1)], rms=(0.01,), sample_rate=RATE)


def test_fades_that_leave_nothing_are_refused():
    with pytest.raises(ValueError, match="leave nothing between"):
        make(samples=2000, fade=1000)
