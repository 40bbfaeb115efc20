"""Bursts and sweeps after which a response has not come to rest: told with its share, and told apart from noise."""

import numpy as np
import pytest
from known_plants import RATE
from scipy.signal import lfilter

from duralab_settings import EstimatorKind, ExcitationKind
from identifier import WarningCode, estimate
from identifier.estimators.rest_check import RestCheck
from identifier.excitation import ExperimentSettings, design_experiment, white

BLOCK = 1024
BURSTS = (ExcitationKind.BURST_RANDOM, ExcitationKind.SWEPT_SINE)


def design(kind, *, share=0.5):
    settings = ExperimentSettings(
        drive_spectra=(white(2.0, 60.0),) * 2,
        rms=(1.0, 1.0),
        duration=40 * BLOCK / RATE,
        block_samples=BLOCK,
        fade=0.1,
        burst_share=share,
        seed=6,
        kind=kind,
    )
    return design_experiment(settings, drives=2, sample_rate=RATE)


def mode(drive, *, blocks, frequency=20.0):
    """Response of two modes that fall by e in so many blocks."""
    pole = np.exp((-1.0 / (blocks * BLOCK / RATE) + 2j * np.pi * frequency) / RATE)
    return lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], drive, axis=-1)


def transients(experiment, response):
    found = estimate(EstimatorKind.H1, experiment.drive, response, experiment.layout).warnings
    return [warning for warning in found if warning.code is WarningCode.TRANSIENT]


def carried_over(experiment, *, blocks):
    """What a block's drive alone leaves in the next block, over the RMS of a response to all, by simulation."""
    drive = experiment.drive.reshape(2, -1, BLOCK)
    alone = np.concatenate([drive, np.zeros_like(drive)], axis=2)
    left = mode(alone, blocks=blocks)[:, :, BLOCK:]
    return np.sqrt(np.mean(left**2, axis=(1, 2)) / np.mean(mode(experiment.drive, blocks=blocks) ** 2, axis=1))


@pytest.mark.parametrize("kind", BURSTS)
@pytest.mark.parametrize("blocks", [0.1, 0.15, 0.2, 0.25, 0.3, 0.4])
def test_a_response_that_rings_on_is_told_with_its_share(kind, blocks):
    experiment = design(kind)
    found = transients(experiment, mode(experiment.drive, blocks=blocks) + 3500.0)
    expected = carried_over(experiment, blocks=blocks)
    assert {warning.channel for warning in found} >= set(np.flatnonzero(expected > 0.015))
    assert {warning.channel for warning in found} <= set(np.flatnonzero(expected > 0.006))
    for warning in found:
        assert warning.size == pytest.approx(expected[warning.channel], rel=0.4)
        assert "rings on into the next one" in str(warning)


@pytest.mark.parametrize("kind", BURSTS)
def test_a_mode_that_outlasts_the_rest_is_told(kind):
    experiment = design(kind)
    found = transients(experiment, mode(experiment.drive, blocks=3.0))
    assert [warning.channel for warning in found] == [0, 1]
    assert min(warning.size for warning in found) > 0.3
    assert all("noise or rings on undamped" in str(warning) for warning in found)


@pytest.mark.parametrize("kind", BURSTS)
@pytest.mark.parametrize("noise", [0.0, 0.001, 0.05])
def test_a_response_that_comes_to_rest_is_good_with_noise_too(kind, noise):
    experiment = design(kind)
    response = mode(experiment.drive, blocks=0.05)
    level = response.std(axis=1, keepdims=True)
    response += noise * level * np.random.default_rng(3).standard_normal(response.shape)
    assert transients(experiment, response) == []


def test_where_nothing_rests_nothing_is_told():
    experiment = design(ExcitationKind.BURST_RANDOM, share=0.95)
    assert transients(experiment, mode(experiment.drive, blocks=0.5)) == []


@pytest.mark.parametrize("pieces", [1, 100, 1023, 1024, 5000])
def test_it_is_the_same_in_pieces(pieces):
    experiment = design(ExcitationKind.BURST_RANDOM)
    response = mode(experiment.drive, blocks=0.3)
    whole, parts = (RestCheck(experiment.layout, drives=2, responses=2) for _ in range(2))
    whole.add(experiment.drive, response)
    for first in range(0, response.shape[1], pieces):
        parts.add(experiment.drive[:, first : first + pieces], response[:, first : first + pieces])
    assert parts.warnings() == whole.warnings() != ()
