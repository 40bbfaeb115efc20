"""A made-up rig with an arc, `y = H (u_lateral + κ u_vertical²)`, its models, and records of it."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from duralab_spectra import CrossSpectra, line_frequencies

SAMPLE_RATE = 200.0
BLOCK, TAPS = 512, 128
NAMES, UNITS = ("vertical", "lateral"), ("m", "m")
KAPPA = 3.0
LEVEL = np.array([0.01, 0.002])
IDENTIFIED = (0.5, 42.0)


@dataclass(frozen=True)
class Model:
    frequency: np.ndarray
    frf: np.ndarray
    identified: slice


def model(frequency, frf, *, identified=IDENTIFIED):
    inside = np.flatnonzero((frequency >= identified[0]) & (frequency <= identified[1]))
    return Model(frequency, frf, slice(inside[0], inside[-1] + 1))


def impulse_responses():
    """Two coupled, well damped channels of very different units: shape (2, 2, TAPS)."""
    time = np.arange(TAPS) / SAMPLE_RATE

    def mode(share, frequency, damping):
        omega = 2.0 * np.pi * frequency
        return share * np.exp(-damping * omega * time) * np.cos(omega * time)

    direct = np.zeros(TAPS)
    direct[1] = 1.0
    h = [
        [direct + mode(0.1, 8.0, 0.3), mode(0.06, 14.0, 0.3)],
        [mode(-0.05, 11.0, 0.25), direct + mode(0.12, 18.0, 0.25)],
    ]
    return np.array(h) * np.array([1e5, 1e3])[:, None, None]


def frequency_response():
    """Lines of a block and the exact FRF on them: shape (lines, n_y, n_u)."""
    return line_frequencies(BLOCK, SAMPLE_RATE), np.fft.rfft(impulse_responses(), n=BLOCK, axis=2).transpose(2, 0, 1)


def exact_model():
    return model(*frequency_response())


def estimated_model(u, y):
    """H1 from Hann blocks."""
    spectra = CrossSpectra(2, 2, block_samples=BLOCK, overlap=0.5, sample_rate=SAMPLE_RATE)
    spectra.add(y - y.mean(axis=1, keepdims=True), u)
    found = spectra.estimate()
    frequency = line_frequencies(BLOCK, SAMPLE_RATE)
    frf = np.zeros(found.s_ab.shape, dtype=complex)
    inside = (frequency >= IDENTIFIED[0]) & (frequency <= IDENTIFIED[1])
    frf[inside] = found.s_ab[inside] @ np.linalg.inv(found.s_bb[inside])
    return model(frequency, frf)


def drive(*, seconds=75.0, seed=0, level=LEVEL, highest=IDENTIFIED[1]):
    """Noise from the band's lower end up to a frequency, at rest at both ends."""
    samples = round(seconds * SAMPLE_RATE)
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal((2, samples)))
    frequency = np.fft.rfftfreq(samples, 1.0 / SAMPLE_RATE)
    lines[:, (frequency < IDENTIFIED[0]) | (frequency > highest)] = 0.0
    position = np.linspace(0.0, 1.0, samples)
    envelope = np.sin(0.5 * np.pi * np.clip(8.0 * np.minimum(position, 1.0 - position), 0.0, 1.0)) ** 2
    noise = np.fft.irfft(lines, samples) * envelope
    return noise / noise.std(axis=1, keepdims=True) * np.asarray(level)[:, None]


def play_linear(u):
    """Response from rest, causal, as long as the drive."""
    return np.array([sum(fftconvolve(u[j], row[j])[: u.shape[1]] for j in range(2)) for row in impulse_responses()])


def play_arc(u, *, kappa=KAPPA):
    return play_linear(np.array([u[0], u[1] + kappa * u[0] ** 2]))
