"""A rig of eight modes and a target: what the first drive is computed from, here and by a peer."""

import numpy as np

RATE, SECONDS, CHANNELS, BLOCK = 1000.0, 120.0, 8, 2048
LOWEST, HIGHEST = 1.0, 100.0


def rig_and_target(*, seconds: float = SECONDS, channels: int = CHANNELS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequencies, FRF and target of a rig whose every channel has its own mode.

    Parameters
    ----------
    seconds : float
        Of the target.
    channels : int
        Drives, and as many responses.

    Returns
    -------
    frequency : ndarray, (lines)
    frf : ndarray, (lines, channels, channels)
    target : ndarray, (channels, samples)
        Noise between 5 and 80 Hz that begins and ends at zero.
    """
    rng = np.random.default_rng(1)
    frequency = np.arange(BLOCK // 2 + 1) * (RATE / BLOCK)
    natural = np.geomspace(8.0, 70.0, channels)
    ratio = frequency[:, None] / natural
    modes = 1.0 / (1.0 - ratio**2 + 2j * 0.3 * ratio)
    shapes = np.eye(channels) + 0.1 * rng.standard_normal((channels, channels))
    frf = np.einsum("im,fm,jm->fij", shapes, modes, shapes)
    # The mean and the Nyquist line of a real signal have no phase.
    frf[[0, -1]] = frf[[0, -1]].real
    samples = round(seconds * RATE)
    lines = np.fft.rfftfreq(samples, 1.0 / RATE)
    spectrum = np.fft.rfft(rng.standard_normal((channels, samples))) * ((lines > 5.0) & (lines < 80.0))
    fade = np.minimum(1.0, np.minimum(np.arange(samples), np.arange(samples)[::-1]) / RATE)
    return frequency, frf, fade * np.fft.irfft(spectrum, samples)
