"""A made-up rig with an arc, `y = H (u_lateral + κ u_vertical²)`, and records of it, for the tests of the drive map."""

import numpy as np

from duralab_spectra import CrossSpectra, line_frequencies
from iterator import control_band, rig_model

from .linear_plants import BLOCK, SAMPLE_RATE, frequency_response, impulse_responses, play

NAMES, UNITS = ("vertical", "lateral"), ("m", "m")
KAPPA = 3.0
LEVEL = np.array([0.01, 0.002])
IDENTIFIED = (0.5, 42.0)
BAND = control_band(2.0, 36.0, sample_rate=SAMPLE_RATE, lower_flank=1.0, upper_flank=3.0)


def at_rest_at_its_ends(samples):
    position = np.linspace(0.0, 1.0, samples)
    return np.sin(0.5 * np.pi * np.clip(8.0 * np.minimum(position, 1.0 - position), 0.0, 1.0)) ** 2


def drive(*, seconds=75.0, seed=0, level=LEVEL, highest=IDENTIFIED[1]):
    """Noise from the band's lower end up to a frequency, at rest at both ends."""
    samples = round(seconds * SAMPLE_RATE)
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal((2, samples)))
    frequency = np.fft.rfftfreq(samples, 1.0 / SAMPLE_RATE)
    lines[:, (frequency < IDENTIFIED[0]) | (frequency > highest)] = 0.0
    noise = np.fft.irfft(lines, samples) * at_rest_at_its_ends(samples)
    return noise / noise.std(axis=1, keepdims=True) * np.asarray(level)[:, None]


def play_arc(u, *, kappa=KAPPA):
    return play(impulse_responses(), np.array([u[0], u[1] + kappa * u[0] ** 2]))


def exact_model(**options):
    frequency, frf = frequency_response(impulse_responses())
    return rig_model(frequency, frf, identified_band=IDENTIFIED, **options)


def estimated_model(u, y):
    """H1 from Hann blocks."""
    spectra = CrossSpectra(2, 2, block_samples=BLOCK, overlap=0.5, sample_rate=SAMPLE_RATE)
    spectra.add(y - y.mean(axis=1, keepdims=True), u)
    found = spectra.estimate()
    frequency = line_frequencies(BLOCK, SAMPLE_RATE)
    frf = np.zeros(found.s_ab.shape, dtype=complex)
    inside = (frequency >= IDENTIFIED[0]) & (frequency <= IDENTIFIED[1])
    frf[inside] = found.s_ab[inside] @ np.linalg.inv(found.s_bb[inside])
    return rig_model(frequency, frf, identified_band=IDENTIFIED)
