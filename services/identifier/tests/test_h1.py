import numpy as np
import pytest
from scipy import signal

from identifier import LARGEST_CONDITION, WhitePink, estimate_h1, h1_from_spectra, pure_random
from spectra import CrossSpectra, SpectraEstimate

RATE = 1000.0
BAND = {"lowest": 1.0, "highest": 100.0}
WELCH = {"block_samples": 1024, "overlap": 0.5, "sample_rate": RATE}
WHITE = WhitePink(lowest_frequency=0.5, highest_frequency=120.0, corner_frequency=0.5, decibels_per_octave=0.0)

# Second-order sections of a 3 x 2 plant: (numerator, denominator) per response and drive.
PLANT = [
    [([0.2, 0.1], [1.0, -1.7, 0.8]), ([0.0, 0.05], [1.0, -0.5])],
    [([0.1], [1.0, -1.2, 0.6]), ([0.3, -0.2], [1.0, -1.6, 0.75])],
    [([0.0, 0.0, 0.3], [1.0, -0.3]), ([-0.2], [1.0, -0.9])],
]


def respond(drive):
    return np.stack([sum(signal.lfilter(*cell, drive[j]) for j, cell in enumerate(row)) for row in PLANT])


def true_frf(frequency):
    rows = [[signal.freqz(*cell, worN=2 * np.pi * frequency / RATE)[1] for cell in row] for row in PLANT]
    return np.asarray(rows).transpose(2, 0, 1)


def random_drives(seconds, seed=0, drives=2):
    samples = round(seconds * RATE)
    return pure_random(WHITE, rms=[1.0] * drives, samples=samples, fade_samples=0, sample_rate=RATE, seed=seed)


def test_periodic_excitation_gives_the_frf_of_a_linear_plant_to_rounding():
    # Every fourth line is excited, so that the Hann window, three lines wide, mixes none of them.
    block, periods, delay_periods = 1024, 6, 4
    generator = np.random.default_rng(11)
    running = CrossSpectra(3, 2, block_samples=block, overlap=0.0, sample_rate=RATE)
    for _ in range(4):
        lines = np.zeros((2, block // 2 + 1), dtype=complex)
        lines[:, 4:-1:4] = np.exp(2j * np.pi * generator.random((2, 127)))
        drive = np.tile(np.fft.irfft(lines, block), periods)
        after_transient = slice(delay_periods * block, None)
        running.add(respond(drive)[:, after_transient], drive[:, after_transient])
    spectra = running.estimate()
    excited = SpectraEstimate(
        frequency=spectra.frequency[4:-1:4],
        s_ab=spectra.s_ab[4:-1:4],
        s_bb=spectra.s_bb[4:-1:4],
        auto_a=spectra.auto_a[4:-1:4],
        blocks=spectra.blocks,
        independent_averages=spectra.independent_averages,
    )
    estimate = h1_from_spectra(excited, lowest=1.0, highest=499.0)
    expected = true_frf(excited.frequency)
    # Lines where two realisations happen to have like phases lose digits to their condition number.
    error = np.linalg.norm(estimate.frf - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert np.max(error / estimate.condition_number) <= 1e-13
    assert np.max(error) <= 1e-12
    np.testing.assert_allclose(estimate.coherence, 1.0, atol=1e-11)


def test_random_excitation_gives_the_frf_up_to_leakage():
    drive = random_drives(120.0)
    estimate = estimate_h1(drive, respond(drive), **WELCH, **BAND)
    band = (estimate.frequency >= 1.0) & (estimate.frequency <= 100.0)
    expected = true_frf(estimate.frequency[band])
    error = np.linalg.norm(estimate.frf[band] - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert np.median(error) < 0.01
    assert np.all(estimate.coherence[band] > 0.95)
    assert estimate.condition_number[band].min() >= 1.0
    assert estimate.condition_number[band].max() < 3.0


def test_a_delay_has_falling_phase():
    drive = random_drives(60.0, drives=1)
    estimate = estimate_h1(drive, np.roll(drive, 5, axis=1), **WELCH, **BAND)
    band = estimate.condition_number > 0
    expected = np.exp(-2j * np.pi * estimate.frequency[band] * 5 / RATE)
    np.testing.assert_allclose(estimate.frf[band, 0, 0], expected, atol=0.02)


def test_nothing_is_estimated_outside_the_band():
    drive = random_drives(30.0)
    estimate = estimate_h1(drive, respond(drive), **WELCH, **BAND)
    outside = (estimate.frequency < 1.0) | (estimate.frequency > 100.0)
    assert outside.sum() > 300
    assert not np.any(estimate.frf[outside])
    assert not np.any(estimate.coherence[outside])
    assert not np.any(estimate.condition_number[outside])


@pytest.mark.parametrize("noise", [0.0, 0.1, 10.0, 1e6])
def test_the_coherence_stays_between_zero_and_one(noise):
    drive = random_drives(15.0)
    response = respond(drive)
    response = response + noise * np.random.default_rng(1).standard_normal(response.shape)
    coherence = estimate_h1(drive, response, **WELCH, **BAND).coherence
    assert np.all((coherence >= 0.0) & (coherence <= 1.0))
    if noise > 1e5:
        # Nothing but noise: what two drives explain of N independent averages by chance.
        assert np.mean(coherence[coherence > 0]) < 0.2


def test_units_of_the_drives_do_not_change_condition_or_coherence():
    drive = random_drives(20.0)
    response = respond(drive)
    units = np.array([[1e-6], [1e5]])
    plain, scaled = (estimate_h1(d, response, **WELCH, **BAND) for d in (drive, units * drive))
    np.testing.assert_allclose(scaled.condition_number, plain.condition_number, rtol=1e-9)
    np.testing.assert_allclose(scaled.coherence, plain.coherence, atol=1e-12)
    np.testing.assert_allclose(scaled.frf * units[:, 0], plain.frf, atol=1e-12)


@pytest.mark.parametrize("difference", [0.0, 1e-3])
def test_drives_that_are_copies_are_refused_although_the_coherence_is_high(difference):
    drive = random_drives(60.0)
    drive[1] = drive[0] + difference * drive[1]
    response = respond(drive)
    alone = estimate_h1(drive[:1], response, **WELCH, **BAND)
    assert np.median(alone.coherence[alone.condition_number > 0]) > 0.99
    with pytest.raises(ValueError, match=rf"singular at .* Hz: .* at most {LARGEST_CONDITION:g} is allowed"):
        estimate_h1(drive, response, **WELCH, **BAND)


def test_fewer_blocks_than_drives_are_refused():
    drive = random_drives(1.6)
    with pytest.raises(ValueError, match="singular"):
        estimate_h1(np.vstack([drive, random_drives(1.6, seed=5)]), respond(drive), **WELCH, **BAND)


@pytest.mark.parametrize(
    ("drive_gain", "response_gain", "band", "message"),
    [
        (0.0, 1.0, BAND, "Drive 1 is silent at"),
        (1.0, 0.0, BAND, "Response 2 is silent at"),
        (1.0, 1.0, {"lowest": 1.0, "highest": 1.5}, None),
        (1.0, 1.0, {"lowest": 1.1, "highest": 1.5}, "No line lies in the band"),
    ],
)
def test_what_cannot_be_estimated_is_refused(drive_gain, response_gain, band, message):
    drive = random_drives(30.0)
    response = respond(drive)
    drive[1] *= drive_gain
    response[2] *= response_gain
    if message is None:
        band = {"lowest": 0.9, "highest": 1.0}
        assert np.count_nonzero(estimate_h1(drive, response, **WELCH, **band).condition_number) == 1
        return
    with pytest.raises(ValueError, match=message):
        estimate_h1(drive, response, **WELCH, **band)
