import re

import numpy as np
import pytest
from scipy import signal

from duralab_settings import ExcitationKind, Spectrum
from identifier.excitation import ExperimentSettings, design_experiment, white
from identifier.uncertainty import (
    can_separate,
    distortion_shares,
    noise_shares,
    separate_distortion,
    separated_verdicts,
)

RATE = 512.0
GAIN = np.array([[1.0, 0.4], [-0.3, 2.0]])
SETTINGS = ExperimentSettings(
    drive_spectra=(white(lowest_frequency=4.0, highest_frequency=80.0),) * 2,
    rms=(1.0, 1.0),
    duration=160.0,
    block_samples=512,
    fade=0.0,
    seed=3,
    kind=ExcitationKind.RANDOM_ORTHOGONAL,
    delay_blocks=1,
    capture_blocks=3,
)


def played(settings, respond, *, noise=0.0):
    experiment = design_experiment(settings, drives=len(settings.levels), sample_rate=RATE)
    response = respond(experiment.drive)
    response = response + noise * np.random.default_rng(5).standard_normal(response.shape)
    return separate_distortion(experiment.drive, response, experiment.layout)


def linear(drive):
    return np.stack([signal.lfilter([1.0], [1.0, -0.5], row) for row in GAIN @ drive])


def in_band_power(levels, psd):
    return np.sum(psd[levels.excited], axis=0) * RATE / 512.0


def test_a_linear_plant_with_noise_is_noisy_and_not_nonlinear():
    levels = played(SETTINGS, linear, noise=0.3)
    # white noise of variance 0.09 has a one-sided density of 2 * 0.09 / rate.
    noise = np.mean(levels.noise_psd[levels.excited], axis=0)
    np.testing.assert_allclose(noise, 2.0 * 0.09 / RATE, rtol=0.05)
    distortion = np.mean(levels.distortion_psd[levels.excited], axis=0)
    assert np.all(np.abs(distortion) < 0.03 * noise)
    true = GAIN[None] * (1.0 / (1.0 - 0.5 * np.exp(-2j * np.pi * levels.frequency / RATE)))[:, None, None]
    error = levels.best_linear_approximation[levels.excited] - true[levels.excited]
    assert np.max(np.abs(error)) < 0.35
    assert np.sqrt(np.mean(np.abs(error) ** 2)) < 0.1
    assert np.all(distortion_shares(levels).worst_frequency == 0.0)
    for sentence in separated_verdicts(levels, responses=("left_vertical", "right_vertical")):
        assert sentence.startswith("No nonlinearity beyond the noise in ")


def test_a_linear_plant_is_linear_in_whatever_units_its_drives_are():
    units = np.array([[1e-9], [1e6]])
    experiment = design_experiment(SETTINGS, drives=2, sample_rate=RATE)
    response = linear(experiment.drive)
    response += 0.1 * np.random.default_rng(5).standard_normal(response.shape)
    one = separate_distortion(experiment.drive, response, experiment.layout)
    other = separate_distortion(experiment.drive * units, response, experiment.layout)
    size = np.max(np.abs(one.best_linear_approximation))
    told = other.best_linear_approximation * units.T
    np.testing.assert_allclose(told, one.best_linear_approximation, atol=1e-10 * size)
    for sentence in separated_verdicts(other, responses=("a", "b")):
        assert sentence.startswith("No nonlinearity beyond the noise in ")


def test_of_a_response_that_is_not_settled_the_verdict_says_that_it_may_be_the_transient():
    sentences = separated_verdicts(played(SETTINGS, linear, noise=0.1), responses=("a", "b"), unsettled={1})
    assert ["transient" in sentence for sentence in sentences] == [False, True]


def test_a_linear_plant_without_noise_has_neither():
    levels = played(SETTINGS, linear)
    floor = 1e-20 * np.max(levels.response_psd)
    assert np.max(levels.noise_psd) < floor
    assert np.max(np.abs(levels.distortion_psd)) < floor


def test_the_amount_is_that_of_a_cube_of_gaussian_drive():
    # For a Gaussian u of variance 1, u^3 = 3 u + He3(u), and He3 has variance 6, spread over three times the band.
    # Brute force tells how much of it falls on the excited lines.
    share = 0.2
    settings = SETTINGS.model_copy(update={"duration": 400.0})
    levels = played(settings, lambda drive: drive + share * drive**3, noise=0.05)
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    u = np.random.default_rng(1).standard_normal((2, 60, 512))
    spectrum = np.fft.rfft(u)
    spectrum[..., ~experiment.layout.excited] = 0.0
    u = np.fft.irfft(spectrum, 512)
    u /= np.sqrt(np.mean(u**2))
    lines = np.fft.rfft(share * (u**3 - 3.0 * u))[..., experiment.layout.excited]
    expected = np.mean(np.sum(2.0 * np.abs(lines) ** 2 / 512.0**2, axis=-1))
    found = in_band_power(levels, levels.distortion_psd)
    np.testing.assert_allclose(found, expected, rtol=0.12)
    gain = np.mean(levels.best_linear_approximation[levels.excited], axis=0).real
    np.testing.assert_allclose(gain, (1.0 + 3.0 * share) * np.eye(2), atol=0.05)


@pytest.mark.parametrize(("power", "odd"), [(3, True), (2, False)])
def test_cubes_fall_on_the_odd_lines_left_out_and_squares_on_the_even_ones(power, odd):
    settings = SETTINGS.model_copy(update={"odd_lines": True, "detection_share": 0.25, "duration": 200.0})
    levels = played(settings, lambda drive: drive + 0.2 * drive**power, noise=0.02)
    silent = levels.odd_psd > 0.0
    np.testing.assert_array_equal(silent.any(axis=1)[::2], False)
    np.testing.assert_array_equal((levels.even_psd != 0.0).any(axis=1)[1::2], False)
    means = [np.mean(psd[psd != 0.0]) for psd in (levels.odd_psd, levels.even_psd)]
    large, small = means if odd else means[::-1]
    assert abs(small) < 1e-3 * large
    if odd:
        # What the realisations scatter by at the excited lines is what the lines left out show.
        assert large == pytest.approx(np.mean(levels.distortion_psd[levels.excited]), rel=0.15)
    else:
        # The even distortion does not reach the excited lines at all.
        assert abs(np.mean(levels.distortion_psd[levels.excited])) < 1e-3 * large
    sentence = separated_verdicts(levels, responses=("a", "b"))[0]
    assert sentence.startswith("Nonlinear ")
    told = re.search(r"\(odd (\d+) %, even 0 %\)" if odd else r"\(odd 0 %, even (\d+) %\)", sentence)
    share = np.sqrt(large / np.mean(levels.response_psd[levels.excited]))
    assert float(told[1]) == pytest.approx(100.0 * share, rel=0.1)


def test_lines_left_out_say_nothing_of_a_linear_plant():
    settings = SETTINGS.model_copy(update={"odd_lines": True, "detection_share": 0.25})
    for noise in (0.0, 0.3):
        sentences = separated_verdicts(played(settings, linear, noise=noise), responses=("a", "b"))
        assert [sentence.startswith("No nonlinearity beyond the noise in ") for sentence in sentences] == [True] * 2


def test_the_columns_of_one_hadamard_realisation_do_not_pass_for_other_phases():
    # Six drives have eight columns: more experiments than drives, but one set of phases.
    settings = SETTINGS.model_copy(
        update={
            "kind": ExcitationKind.HADAMARD,
            "drive_spectra": (Spectrum(white_pink=SETTINGS.spectra[0]),) * 6,
            "rms": (1.0,) * 6,
            "duration": 70.0,
        }
    )
    one, two = (
        design_experiment(settings.model_copy(update={"realisations": number}), drives=6, sample_rate=RATE).layout
        for number in (1, 2)
    )
    assert not can_separate(one, drives=6)
    assert can_separate(two, drives=6)


def test_the_verdict_names_channel_frequency_and_share():
    def respond(drive):
        lines = np.fft.rfft(drive[0] ** 3)
        frequency = np.fft.rfftfreq(drive.shape[1], 1.0 / RATE)
        bent = np.fft.irfft(lines * np.exp(-((frequency - 20.0) ** 2) / 8.0), drive.shape[1])
        return np.stack([drive[0] + 0.2 * bent, drive[1]])

    levels = played(SETTINGS, respond, noise=0.02)
    sentences = separated_verdicts(levels, responses=("left_longitudinal", "right_vertical"))
    shares = distortion_shares(levels)
    assert shares.worst_frequency[0] == pytest.approx(20.0, abs=1.5)
    assert f"Nonlinear {100 * shares.worst[0]:.0f} % of the response at" in sentences[0]
    assert "Hz in left longitudinal, " in sentences[0]
    assert sentences[1].startswith("No nonlinearity beyond the noise in right vertical; noise ")
    assert noise_shares(levels).over_band[1] == pytest.approx(0.02 * np.sqrt(2 * 76 / RATE), rel=0.1)


@pytest.mark.parametrize(
    ("changes", "possible"),
    [
        ({}, True),
        ({"capture_blocks": 1}, False),
        ({"capture_blocks": 1, "repeats": 2}, True),
        ({"realisations": 1}, False),
        ({"kind": ExcitationKind.PURE_RANDOM}, False),
    ],
)
def test_an_experiment_that_cannot_tell_them_apart_is_known_and_refused(changes, possible):
    settings = SETTINGS.model_copy(update={**changes})
    experiment = design_experiment(settings, drives=2, sample_rate=RATE)
    assert can_separate(experiment.layout, drives=2) == possible
    if not possible:
        with pytest.raises(ValueError, match="do not tell noise from distortion"):
            separate_distortion(experiment.drive, experiment.drive, experiment.layout)


@pytest.mark.parametrize("kind", [ExcitationKind.PSEUDO_RANDOM, ExcitationKind.HADAMARD, ExcitationKind.ORTHOGONAL_DFT])
def test_every_multisine_serves(kind):
    levels = played(SETTINGS.model_copy(update={"kind": kind}), linear, noise=0.3)
    np.testing.assert_allclose(np.mean(levels.noise_psd[levels.excited], axis=0), 2.0 * 0.09 / RATE, rtol=0.05)
    assert np.all(np.abs(np.mean(levels.distortion_psd[levels.excited], axis=0)) < 0.05 * 2.0 * 0.09 / RATE)
