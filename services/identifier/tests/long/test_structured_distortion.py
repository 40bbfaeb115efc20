"""A cubic plant between two filters: which excitations find its best linear approximation, which another one."""

import numpy as np
import pytest
from scipy import signal
from short_experiments import RATE, blocks_of

from duralab_settings import ExcitationKind
from identifier.excitation import ExperimentSettings, design_experiment, white

DRIVES, CUBE = 4, 0.15
FIRST, SECOND = signal.butter(2, 30.0, fs=RATE), signal.butter(2, 40.0, fs=RATE)
INWARD, OUTWARD = np.random.default_rng(0).standard_normal((2, DRIVES, DRIVES)) / np.sqrt(DRIVES) + np.eye(DRIVES)


def respond(drive):
    inside = signal.lfilter(*FIRST, INWARD @ drive)
    return OUTWARD @ signal.lfilter(*SECOND, inside + CUBE * inside**3)


def best_linear_approximation(frequency):
    """Return the FRF for Gaussian drives of RMS 1, where a cube answers like a gain of three variances (Bussgang)."""
    first, second = (signal.freqz(*each, worN=2 * np.pi * frequency / RATE)[1] for each in (FIRST, SECOND))
    variance = (INWARD**2).sum(axis=1) * np.mean(np.abs(first) ** 2)
    linear = OUTWARD @ np.diag(1.0 + 3.0 * CUBE * variance) @ INWARD
    return (first * second)[:, None, None] * linear


def error(kind, experiments, seed):
    """Relative RMS error of the FRF after a number of experiments."""
    columns = 1 if kind is ExcitationKind.PSEUDO_RANDOM else DRIVES
    settings = ExperimentSettings(
        kind=kind,
        drive_spectra=(white(0.5, 50.0),) * DRIVES,
        rms=(1.0,) * DRIVES,
        duration=1e4,
        block_samples=2048,
        fade=0.5,
        seed=seed,
        capture_blocks=1,
        realisations=experiments // columns,
    )
    experiment = design_experiment(settings, drives=DRIVES, sample_rate=RATE)
    excited = experiment.layout.excited
    measured = type(experiment)(drive=respond(experiment.drive), layout=experiment.layout)
    u, y = (np.fft.rfft(blocks_of(each), axis=-1)[..., excited].transpose(2, 1, 0) for each in (experiment, measured))
    true = best_linear_approximation(experiment.layout.frequency[excited])
    estimated = (y @ u.conj().swapaxes(1, 2)) @ np.linalg.inv(u @ u.conj().swapaxes(1, 2))
    return np.linalg.norm(estimated - true) / np.linalg.norm(true)


def mean_error(kind, experiments):
    return np.mean([error(kind, experiments, seed) for seed in range(3)])


@pytest.mark.parametrize("kind", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.PSEUDO_RANDOM])
def test_distortion_averages_out_like_noise_where_every_drive_has_phases_of_its_own(kind):
    few, many = mean_error(kind, 16), mean_error(kind, 64)
    assert 1.5 < few / many < 2.5


@pytest.mark.parametrize("kind", [ExcitationKind.HADAMARD, ExcitationKind.ORTHOGONAL_DFT])
def test_one_block_for_all_drives_ends_at_another_frf_however_many_realisations_there_are(kind):
    few, many = mean_error(kind, 16), mean_error(kind, 64)
    assert few / many < 1.3
    assert many > 2.0 * mean_error(ExcitationKind.RANDOM_ORTHOGONAL, 64)
