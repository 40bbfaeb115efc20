"""Records that the product and its peers identify, by numpy and scipy alone: a peer's environment makes them too."""

import numpy as np
from scipy import signal

RATE = 1000.0
BLOCK = 2048
OVERLAP = 0.5
RESONANCES, DAMPING = (20.0, 37.0), 0.01


def noise_record(*, seconds: float, channels: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return white drives and responses that mix them, with a tenth of noise; each (channels, samples)."""
    rng = np.random.default_rng(seed)
    drive = rng.standard_normal((channels, round(seconds * RATE)))
    response = rng.standard_normal((channels, channels)) @ drive
    response += 0.1 * rng.standard_normal(response.shape)
    return drive, response


def scaled_record() -> tuple[np.ndarray, np.ndarray]:
    """Return a record of flat spectra and channels of one size, where it does not matter how Hv scales them."""
    drive, response = noise_record(seconds=600.0, channels=2)
    return drive, response / np.std(response, axis=1, keepdims=True)


def resonant_record(*, seconds: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two white drives and the responses of two lightly damped masses, with a share of noise."""
    rng = np.random.default_rng(7)
    drive = rng.standard_normal((2, round(seconds * RATE)))
    response = np.stack([signal.lfilter([0.0, 0.01, 0.002], _poles(each), drive.T @ [1.0, 0.4]) for each in RESONANCES])
    response += signal.lfilter([0.0, 0.004], _poles(RESONANCES[1]), drive[1])
    return drive, response + noise * np.std(response, axis=1, keepdims=True) * rng.standard_normal(response.shape)


def _poles(frequency: float) -> list[float]:
    angle = 2.0 * np.pi * frequency / RATE
    radius = np.exp(-DAMPING * angle)
    return [1.0, -2.0 * radius * np.cos(angle), radius**2]
