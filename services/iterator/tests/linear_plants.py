"""Plants with an analytic FRF, and targets, for the tests of the iteration."""

import numpy as np
from scipy.signal import fftconvolve

from duralab_spectra import line_frequencies

SAMPLE_RATE = 200.0
BLOCK = 512
TAPS = 128


def impulse_responses() -> np.ndarray:
    """Two coupled, well damped channels of very different units: shape (2, 2, TAPS)."""
    time = np.arange(TAPS) / SAMPLE_RATE

    def mode(frequency: float, damping: float) -> np.ndarray:
        omega = 2.0 * np.pi * frequency
        return np.exp(-damping * omega * time) * np.cos(omega * time)

    direct = np.zeros(TAPS)
    direct[1] = 1.0
    h = np.empty((2, 2, TAPS))
    h[0, 0] = direct + 0.10 * mode(8.0, 0.30)
    h[0, 1] = 0.06 * mode(14.0, 0.30)
    h[1, 0] = -0.05 * mode(11.0, 0.25)
    h[1, 1] = direct + 0.12 * mode(18.0, 0.25)
    return h * np.array([1e5, 1e3])[:, None, None]


def frequency_response(h: np.ndarray, block: int = BLOCK) -> tuple[np.ndarray, np.ndarray]:
    """Lines of a block and the exact FRF on them: shape (lines, n_y, n_u)."""
    return line_frequencies(block, SAMPLE_RATE), np.ascontiguousarray(
        np.fft.rfft(h, n=block, axis=2).transpose(2, 0, 1)
    )


def play(h: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Response from rest, causal, as long as the drive."""
    samples = drive.shape[1]
    return np.array([sum(fftconvolve(drive[j], row[j])[:samples] for j in range(drive.shape[0])) for row in h])


def noise_target(samples: int, *, seed: int = 1, level: tuple[float, ...] = (900.0, 40.0)) -> np.ndarray:
    """White noise that rests for the first and the last fifth, long enough for the band's flanks to ring out."""
    noise = np.random.default_rng(seed).standard_normal((len(level), samples))
    position = np.linspace(0.0, 1.0, samples)
    envelope = np.clip(5.0 * np.minimum(position, 1.0 - position) - 1.0, 0.0, 1.0)
    return noise * envelope * np.asarray(level)[:, None]
