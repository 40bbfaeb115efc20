import numpy as np
import pytest

import duralab_spectra
from duralab_settings import WhitePinkSpectrum
from identifier.excitation import power_density, pure_random, white

RATE = 1000.0
PINK = WhitePinkSpectrum(lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0)


def make(samples=60_000, fade=1000, rms=(0.01, 0.02, 0.5), seed=3, spectrum=PINK):
    return pure_random(spectrum, rms=rms, samples=samples, fade_samples=fade, sample_rate=RATE, seed=seed)


def test_the_rms_between_the_fades_is_exact():
    np.testing.assert_allclose(duralab_spectra.rms(make()[:, 1000:-1000]), [0.01, 0.02, 0.5], rtol=1e-14)


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
    density = duralab_spectra.auto_spectra(drive, block_samples=4096, overlap=0.5, sample_rate=RATE)[:, 0]
    frequency = duralab_spectra.line_frequencies(4096, RATE)

    def level(low, high):
        return 10 * np.log10(np.mean(density[(frequency >= low) & (frequency <= high)]))

    assert level(1.0, 2.5) == pytest.approx(level(2.5, 4.8), abs=0.4)
    # Two octaves above one another, around 10 and 40 Hz: 12 dB.
    assert level(9.5, 10.5) - level(38.0, 42.0) == pytest.approx(12.0, abs=0.4)


def test_a_slope_of_zero_is_white():
    white = WhitePinkSpectrum(
        lowest_frequency=1.0, highest_frequency=100.0, corner_frequency=1.0, decibels_per_octave=0.0
    )
    np.testing.assert_array_equal(
        power_density(white, np.array([0.5, 1.0, 30.0, 100.0, 101.0])), [0.0, 1.0, 1.0, 1.0, 0.0]
    )


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


def test_fades_that_leave_nothing_are_refused():
    with pytest.raises(ValueError, match="leave nothing between"):
        make(samples=2000, fade=1000)


def test_every_drive_can_have_its_own_psd():
    drive = make(rms=(1.0, 1.0), fade=0, spectrum=(white(1.0, 10.0), white(20.0, 40.0)))
    power = np.abs(np.fft.rfft(drive, axis=1)) ** 2
    frequency = np.fft.rfftfreq(60_000, 1 / RATE)
    assert power[0, frequency > 10.5].sum() < 1e-20 * power[0].sum()
    assert power[1, frequency < 19.5].sum() < 1e-20 * power[1].sum()
