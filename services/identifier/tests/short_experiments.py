"""Experiments that the tests of the excitation look at."""

import numpy as np

from duralab_settings import ExcitationKind, WhitePinkSpectrum
from identifier.excitation import ExperimentSettings, white

RATE = 1000.0
WHITE = white(0.5, 50.0)
PINK = WhitePinkSpectrum(lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0)
MULTISINES = [kind for kind in ExcitationKind if kind.is_multisine]


def settings_of(drives=3, *, level="rms", **changes):
    """Settings of a short experiment with two groups of actuators."""
    values = {
        "drive_spectra": tuple(PINK if index % 2 else WHITE for index in range(drives)),
        level: tuple(0.5 + index for index in range(drives)),
        "duration": 40.0,
        "block_samples": 2048,
        "fade": 0.25,
        "seed": 11,
    }
    return ExperimentSettings(**(values | changes))


def blocks_of(experiment):
    """Cut the blocks that are used, shape (blocks, drives, block_samples)."""
    layout, pieces = experiment.layout, []
    for capture in layout.captures:
        used = experiment.drive[:, capture.start : capture.start + capture.periods * layout.block_samples]
        pieces.append(used.reshape(used.shape[0], capture.periods, -1).swapaxes(0, 1))
    return np.concatenate(pieces)


def drive_coherence(experiment):
    """Largest magnitude off the diagonal of S_uu scaled to unit diagonal, over the excited lines."""
    lines = np.fft.rfft(blocks_of(experiment), axis=-1)[..., experiment.layout.excited]
    s_uu = np.einsum("bif,bjf->fij", lines, lines.conj())
    scale = np.sqrt(np.einsum("fii->fi", s_uu).real)
    return np.max(np.abs(s_uu / (scale[:, :, None] * scale[:, None, :]) - np.eye(lines.shape[1])))
