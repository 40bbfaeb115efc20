"""An experiment whose responses have the spectra of a target, by a model of the rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import fftconvolve

from duralab_proto.v1.array_pb2 import CHANNEL_KIND_DISPLACEMENT, Channel
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, SettingsError
from duralab_spectra import line_frequencies, rms
from identifier import (
    ExperimentSettings,
    RigUnderTest,
    ValidBand,
    estimate_experiment,
    estimate_shaped,
    separate_distortion,
    shape_of,
    shaped_experiment,
    white,
)

RATE, BLOCK = 200.0, 512
LOWEST, HIGHEST = 1.0, 40.0
RIG = RigUnderTest(
    name="coupled",
    sample_rate=RATE,
    drives=tuple(
        Channel(name=name, unit="m", minimum=-0.1, maximum=0.1, kind=CHANNEL_KIND_DISPLACEMENT)
        for name in ("vertical", "lateral")
    ),
    responses=tuple(Channel(name=name, unit="N") for name in ("up", "across")),
    longest_drive_seconds=600.0,
    content_hash="abc",
)
TIME = np.arange(64) / RATE
# The lateral force follows the vertical stroke nearly as much as its own, so that drives of a target go together.
PULSES = np.array([[1e5, 1e4], [9e4, 3e4]])[:, :, None] * np.array(
    [
        [np.exp(-TIME / 0.03) * np.cos(2.0 * np.pi * 9.0 * TIME), np.exp(-TIME / 0.02)],
        [np.exp(-TIME / 0.04) * np.cos(2.0 * np.pi * 6.0 * TIME), np.exp(-TIME / 0.02)],
    ]
)
FREQUENCY = line_frequencies(BLOCK, RATE)
TRUE = np.einsum("ijt,ft->fij", PULSES, np.exp(-2j * np.pi * FREQUENCY[:, None] * TIME))
SMALL = np.full((FREQUENCY.size, 2), 1e-6)
# Of drives that were alone in the first experiment.
COVARIANCE = np.tile(1e6 * np.eye(2, dtype=complex), (FREQUENCY.size, 1, 1))
BAND = ValidBand(LOWEST, HIGHEST, RATE, BLOCK)


def settings(lowest=LOWEST):
    return ExperimentSettings(
        kind=ExcitationKind.RANDOM_ORTHOGONAL,
        drive_spectra=(white(lowest, HIGHEST),) * 2,
        rms=(1e-3, 1e-3),
        duration=40.0,
        block_samples=BLOCK,
        fade=1.0,
        seed=3,
        capture_blocks=2,
    )


SETTINGS = settings()
ESTIMATOR = EstimatorSettings(kind=EstimatorKind.LOCAL_POLYNOMIAL, block_samples=BLOCK)


def played(drive):
    return np.array([sum(fftconvolve(drive[j], row[j])[: drive.shape[1]] for j in range(2)) for row in PULSES])


def target(seconds=30.0):
    """Return two independent responses with peaks at 4 and 15 Hz; they end at rest."""
    frequency = np.fft.rfftfreq(round(seconds * RATE), 1.0 / RATE)
    phases = np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, (2, frequency.size))
    size = np.array([[300.0], [40.0]]) * np.exp(-0.5 * ((frequency - np.array([[4.0], [15.0]])) / 2.0) ** 2)
    samples = np.fft.irfft(size * np.exp(1j * phases), axis=1) * np.hanning(round(seconds * RATE))
    return samples * np.array([[300.0], [40.0]]) / rms(samples)[:, None]


def shape(frf=TRUE, **changes):
    given = {
        "names": ("up", "across"),
        "frf": frf,
        "residual_psd": SMALL,
        "row_covariance": COVARIANCE,
        "band": BAND,
        "drive_map": None,
        "target_band": (0.3, 40.0),
        "level": 0.5,
    } | changes
    # A static load and what lies above the band are no part of what is shaped.
    samples = target()
    hum = 500.0 * np.sin(2.0 * np.pi * 60.0 * np.arange(samples.shape[1]) / RATE)
    return shape_of(samples + hum + np.array([[5000.0], [-70.0]]), **given)


def captured(experiment, record):
    return np.concatenate(
        [
            record[:, capture.start : capture.start + experiment.layout.samples_of(capture)]
            for capture in experiment.layout.captures
        ],
        axis=1,
    )


def test_with_the_true_model_the_responses_have_the_level_and_the_spectra_of_the_target_and_are_independent():
    experiment, as_played = shaped_experiment(shape(), SETTINGS, rig=RIG)
    response = captured(experiment, played(experiment.drive))
    assert as_played.level == 0.5
    np.testing.assert_allclose(rms(response), 0.5 * rms(target()), rtol=0.01)
    np.testing.assert_allclose(np.corrcoef(response), np.eye(2), atol=0.02)
    # Half a period's worth of smoothing aside, the power lies where the target has it.
    power = np.abs(np.fft.rfft(response, axis=1)) ** 2
    frequency = np.fft.rfftfreq(response.shape[1], 1.0 / RATE)
    centre = (power @ frequency) / power.sum(axis=1)
    np.testing.assert_allclose(centre, [4.0, 15.0], rtol=0.12)
    # The drives go together: alone they would load the lateral response far more.
    assert abs(np.corrcoef(captured(experiment, experiment.drive))[0, 1]) > 0.8


def test_the_frf_is_found_from_drives_that_go_together_by_way_of_a_wrong_model():
    rng = np.random.default_rng(6)
    wrong = TRUE * (1.0 + 0.2 * rng.standard_normal((2, 2)))
    experiment, as_played = shaped_experiment(shape(wrong), SETTINGS, rig=RIG)
    response = played(experiment.drive)
    response += 0.005 * rms(response)[:, None] * rng.standard_normal(response.shape)
    found = estimate_shaped(as_played, ESTIMATOR, experiment.layout, mapped=experiment.drive, response=response)
    lines = found.valid
    # In what the experiment drives: power per line is the target's, and far from its peaks noise remains.
    driven = np.linalg.inv(wrong[lines]) * as_played.density[lines, None, :]

    def error(frf):
        return np.linalg.norm((frf[lines] - TRUE[lines]) @ driven) / np.linalg.norm(TRUE[lines] @ driven)

    assert error(found.frf) < 0.01 < 0.1 < error(wrong)
    # From the drives themselves nothing can be estimated: they are nearly one.
    with pytest.raises(ValueError, match="singular"):
        estimate_experiment(ESTIMATOR, experiment.layout, drive=experiment.drive, response=response)
    # The spectrum of the drives is theirs, so that the covariance of the FRF is.
    periods = captured(experiment, experiment.drive).reshape(2, -1, BLOCK)
    density = 2.0 / (RATE * BLOCK) * np.mean(np.abs(np.fft.rfft(periods, axis=2)) ** 2, axis=1).T
    np.testing.assert_allclose(found.drive_psd[lines], density[lines], rtol=0.02)
    levels = separate_distortion(as_played.predicted(experiment.drive).response, response, experiment.layout)
    assert np.all(np.abs(levels.distortion_psd[lines]) < 0.01 * levels.response_psd[lines].max())


def test_a_drive_beyond_a_limit_lowers_the_level_of_all():
    narrow = replace(
        RIG,
        drives=tuple(
            Channel(name=channel.name, unit="m", minimum=-0.003, maximum=0.003, kind=channel.kind)
            for channel in RIG.drives
        ),
    )
    whole, _ = shaped_experiment(shape(), SETTINGS, rig=RIG)
    held, as_played = shaped_experiment(shape(), SETTINGS, rig=narrow)
    assert np.max(np.abs(whole.drive)) > 0.003
    assert 0.9 * 0.003 < np.max(np.abs(held.drive)) <= 0.003
    assert as_played.level < 0.5
    np.testing.assert_allclose(held.drive, (as_played.level / 0.5) * whole.drive, rtol=1e-9, atol=1e-12)
    tiny = replace(RIG, drives=tuple(Channel(name=c.name, unit="m", minimum=-1e-5, maximum=1e-5) for c in RIG.drives))
    with pytest.raises(SettingsError, match=r"At 0\.1 times the level of 0\.5 drive \w+ would still pass a limit"):
        shaped_experiment(shape(), SETTINGS, rig=tiny)


def test_a_model_that_does_not_know_what_the_responses_will_be_is_refused():
    _, as_played = shaped_experiment(shape(residual_psd=1e7 * SMALL), SETTINGS, rig=RIG)
    assert as_played.level == 0.5
    # The variance of a response's error is linear in the residual: 0.55 times the level became 2 times.
    with pytest.raises(SettingsError, match=r"the random error of across is 2 times its level at the target") as found:
        shaped_experiment(shape(residual_psd=np.array([1.0, 1.3e8]) * SMALL), SETTINGS, rig=RIG)
    assert found.value.field == "shape.model"
    with pytest.raises(SettingsError, match="does not state how uncertain it is"):
        shape(residual_psd=0.0 * SMALL)


def test_what_does_not_fit_is_refused():
    with pytest.raises(SettingsError, match=r"the target of 2 responses and the rig 1 drives"):
        shape(frf=TRUE[:, :, :1])
    with pytest.raises(SettingsError, match=r"holds no line of the model"):
        shape(target_band=(2.0, 2.1))
    with pytest.raises(SettingsError, match=r"cannot be inverted"):
        shape(frf=np.ones_like(TRUE))
    with pytest.raises(SettingsError, match=r"The target of across does not move in its band"):
        shape_of(
            target() * np.array([[1.0], [0.0]]),
            names=("up", "across"),
            frf=TRUE,
            residual_psd=SMALL,
            row_covariance=COVARIANCE,
            band=BAND,
            drive_map=None,
            target_band=(2.0, 30.0),
            level=0.5,
        )
    for change, sentence in (
        ({"kind": ExcitationKind.PURE_RANDOM, "capture_blocks": 1}, r"pure_random; only a multisine can be shaped"),
        ({"block_samples": 256}, r"blocks of 256 samples and the model of the shape blocks of 512"),
        ({"drive_spectra": settings(0.4).drive_spectra}, r"0\.4 to 40 Hz; the model of the shape is valid from 1 to"),
    ):
        with pytest.raises(SettingsError, match=sentence):
            shaped_experiment(shape(), SETTINGS.model_copy(update=change), rig=RIG)
