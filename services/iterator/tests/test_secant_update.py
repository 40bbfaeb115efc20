from dataclasses import replace

import numpy as np
import pytest

from duralab_settings import SecantSettings, StopCriteria, UpdateKind
from duralab_spectra import line_frequencies
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    IterationHistory,
    ModelUncertainty,
    Playback,
    UpdateSettings,
    control_band,
    rig_model,
    run_campaign,
)
from iterator.model import StepSpectra
from iterator.updates import secant_update
from iterator.updates.secant_fit import fit_secant
from iterator.updates.secant_update import secant_model

from .linear_plants import BLOCK, SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
UNGUARDED = {"smallest_correction": 1e-6, "largest_correction": 1e6, "weigh_by_coherence": False, "smooth_lines": False}


def errors(model, *, kind, playbacks, gain=0.8, band=BAND, samples=8001, **more):
    h = impulse_responses()
    settings = UpdateSettings(band=band, iteration_gain=np.full(2, gain), kind=kind, **more)
    result = run_campaign(
        lambda drive: play(h, drive),
        noise_target(samples),
        model=model,
        settings=CampaignSettings(update=settings, stop=StopCriteria(iterations=playbacks, **NO_BOUNDS)),
    )
    return np.array([iteration.metrics.overall_relative_rms_error for iteration in result.iterations])


def wrong_model(change):
    frequency, frf = frequency_response(impulse_responses())
    return rig_model(frequency, change(frequency, frf), identified_band=(1.0, 70.0))


def swapped(frequency, frf):
    """An error on the drives' side: each drive also moves the other one's actuator."""
    mixing = np.array([[1.0, 0.5], [-0.5, 1.0]])
    return np.matmul(frf, mixing)


def test_an_error_on_the_drives_side_makes_plain_adaptive_modelling_diverge_and_the_secant_update_converge():
    model = wrong_model(swapped)
    adaptive = errors(model, kind=UpdateKind.ADAPTIVE_MODELLING, playbacks=7, **UNGUARDED)
    secant = errors(model, kind=UpdateKind.SECANT, playbacks=7)
    assert adaptive[-1] > 1.0
    assert secant[-1] <= 1e-3


@pytest.mark.parametrize("accept_segments", [False, True])
def test_a_gain_error_and_a_delay_are_learned(accept_segments):
    def delayed(frequency, frf):
        return 1.4 * frf * np.exp(-2j * np.pi * frequency * 2.0 / SAMPLE_RATE)[:, None, None]

    # Two samples are 72 degrees at 20 Hz.
    band = control_band(2.0, 20.0, sample_rate=SAMPLE_RATE)
    found = errors(
        wrong_model(delayed), kind=UpdateKind.SECANT, playbacks=10, accept_segments=accept_segments, band=band
    )
    assert found[-1] <= 1e-4


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_delay_beyond_half_a_period_and_a_wrong_sign_are_learned_too(sign):
    def delayed(frequency, frf):
        return sign * 1.4 * frf * np.exp(-2j * np.pi * frequency * 2.0 / SAMPLE_RATE)[:, None, None]

    # Two samples are 216 degrees at 60 Hz: the model asks the wrong way in half of the band.
    found = errors(wrong_model(delayed), kind=UpdateKind.SECANT, playbacks=10)
    assert found[-1] <= 1e-4


def random_spectra(rng, *, lines, blocks=40):
    drives = rng.standard_normal((blocks, lines, 2)) + 1j * rng.standard_normal((blocks, lines, 2))
    return drives, np.einsum("bli,blj->lij", drives, drives.conj()) / blocks


def test_steps_that_the_identified_model_explains_leave_it_exactly_as_it_is():
    rng = np.random.default_rng(4)
    # Small whole numbers: sums and products are exact, so that no rounding stands for an error of the method.
    frf = (rng.integers(-4, 5, (9, 3, 2)) + 1j * rng.integers(-4, 5, (9, 3, 2))).astype(np.complex128)
    drives = (rng.integers(-4, 5, (8, 9, 2)) + 1j * rng.integers(-4, 5, (8, 9, 2))).astype(np.complex128)
    responses = np.einsum("lij,blj->bli", frf, drives)
    fit = fit_secant(
        StepSpectra(
            np.einsum("bli,blj->lij", responses, drives.conj()),
            np.einsum("bli,blj->lij", drives, drives.conj()),
            np.sum(np.abs(responses) ** 2, axis=0),
        ),
        frf,
        identification_drive=np.broadcast_to(np.eye(2, dtype=np.complex128), (9, 2, 2)),
        prior_strength=0.3,
        response_weight=np.ones(3),
        drive_scale=np.ones(2),
        averages=40.0,
    )
    np.testing.assert_array_equal(fit.frf, frf)
    assert np.max(np.abs(fit.uncertainty)) < 1e-12


def test_many_steps_against_a_weak_prior_recover_the_rig_and_a_strong_one_keeps_the_model():
    rng = np.random.default_rng(5)
    truth = rng.standard_normal((7, 2, 2)) + 1j * rng.standard_normal((7, 2, 2))
    model = rng.standard_normal((7, 2, 2)) + 1j * rng.standard_normal((7, 2, 2))
    drives, s_uu = random_spectra(rng, lines=7)
    responses = np.einsum("lij,blj->bli", truth, drives)
    s_yu = np.einsum("bli,blj->lij", responses, drives.conj()) / drives.shape[0]
    spectra = StepSpectra(s_yu, s_uu, np.mean(np.abs(responses) ** 2, axis=0))
    for strength, expected in ((1e-9, truth), (1e9, model)):
        fit = fit_secant(
            spectra,
            model,
            identification_drive=np.broadcast_to(np.diag([4.0, 0.25]).astype(np.complex128), (7, 2, 2)),
            prior_strength=strength,
            response_weight=np.ones(2),
            drive_scale=np.array([2.0, 0.5]),
            averages=40.0,
        )
        np.testing.assert_allclose(fit.frf, expected, rtol=1e-6)


@pytest.mark.parametrize(("noise", "strength"), [(0.0, 0.03), (10.0, 0.3)])
def test_the_prior_gives_way_where_the_steps_contradict_it_and_not_where_nothing_explains_them(noise, strength):
    rng = np.random.default_rng(5)
    truth = rng.standard_normal((7, 2, 2)) + 1j * rng.standard_normal((7, 2, 2))
    s_uu = random_spectra(rng, lines=7)[1]
    explained = np.einsum("lij,ljk,lik->li", truth, s_uu, truth.conj()).real
    fit = fit_secant(
        StepSpectra(np.matmul(truth, s_uu), s_uu, (1.0 + noise) * explained),
        -truth,
        # A prior shaped like the steps: the fit is the mean of truth and model, weighted 1 to κ.
        identification_drive=s_uu,
        prior_strength=0.3,
        response_weight=np.ones(2),
        drive_scale=np.ones(2),
        averages=40.0,
    )
    np.testing.assert_allclose(fit.frf, truth * (1.0 - strength) / (1.0 + strength), rtol=1e-9)


def test_the_uncertainty_is_how_far_the_fit_scatters_around_the_rig():
    rng = np.random.default_rng(8)
    lines, blocks = 400, 40
    truth = np.broadcast_to(rng.standard_normal((3, 2)) + 1j * rng.standard_normal((3, 2)), (lines, 3, 2))
    drives = rng.standard_normal((blocks, lines, 2)) + 1j * rng.standard_normal((blocks, lines, 2))
    noise = rng.standard_normal((blocks, lines, 3)) + 1j * rng.standard_normal((blocks, lines, 3))
    responses = np.einsum("lij,blj->bli", truth, drives) + noise
    fit = fit_secant(
        StepSpectra(
            np.einsum("bli,blj->lij", responses, drives.conj()) / blocks,
            np.einsum("bli,blj->lij", drives, drives.conj()) / blocks,
            np.mean(np.abs(responses) ** 2, axis=0),
        ),
        truth,
        identification_drive=np.broadcast_to(np.eye(2, dtype=np.complex128), (lines, 2, 2)),
        prior_strength=1e-9,
        response_weight=np.ones(3),
        drive_scale=np.ones(2),
        averages=float(blocks),
    )
    wrong = fit.frf - truth
    scatter = np.mean(np.einsum("lij,lik->ljk", wrong.conj(), wrong), axis=0)
    # The mean of 400 lines is known to some 5 %, and the fit itself explains 2 of 40 degrees of freedom.
    np.testing.assert_allclose(np.diag(np.mean(fit.uncertainty, axis=0)).real, np.diag(scatter).real, rtol=0.15)


def test_a_line_that_no_step_moved_is_as_the_identification_left_it():
    rng = np.random.default_rng(9)
    truth = rng.standard_normal((3, 2, 2)) + 1j * rng.standard_normal((3, 2, 2))
    # Moved, moved by little, and not at all.
    power = np.array([1.0, 1e-6, 0.0])[:, None, None]
    fit = fit_secant(
        StepSpectra(power * 2.0 * truth, power * np.eye(2, dtype=np.complex128), power[:, 0] * np.ones((3, 2)) * 50.0),
        truth,
        identification_drive=np.broadcast_to(np.eye(2, dtype=np.complex128), (3, 2, 2)),
        prior_strength=1.0,
        response_weight=np.ones(2),
        drive_scale=np.ones(2),
        averages=10.0,
    )
    np.testing.assert_array_equal(fit.frf[2], truth[2])
    np.testing.assert_array_equal(fit.uncertainty[2], 0.0)
    assert np.all(np.einsum("fii->fi", fit.uncertainty).real[:2] > 0.0)


def test_the_fit_does_not_depend_on_units():
    rng = np.random.default_rng(6)
    model = rng.standard_normal((5, 2, 2)) + 1j * rng.standard_normal((5, 2, 2))
    drives, s_uu = random_spectra(rng, lines=5)
    responses = rng.standard_normal((40, 5, 2)) + 1j * rng.standard_normal((40, 5, 2))
    s_yu = np.einsum("bli,blj->lij", responses, drives.conj()) / 40
    auto = np.mean(np.abs(responses) ** 2, axis=0)
    s_id = np.broadcast_to(np.diag([4.0, 0.25]).astype(np.complex128), (5, 2, 2))
    u, y = np.array([1e-3, 1e4]), np.array([1e5, 1e-2])
    plain = fit_secant(
        StepSpectra(s_yu, s_uu, auto),
        model,
        identification_drive=s_id,
        prior_strength=0.3,
        response_weight=np.array([1.0, 2.0]),
        drive_scale=np.array([2.0, 0.5]),
        averages=40.0,
    )
    scaled = fit_secant(
        StepSpectra(s_yu * y[:, None] * u, s_uu * u[:, None] * u, auto * y**2),
        model * y[:, None] / u,
        identification_drive=s_id * u[:, None] * u,
        prior_strength=0.3,
        response_weight=np.array([1.0, 2.0]) / y,
        drive_scale=np.array([2.0, 0.5]) * u,
        averages=40.0,
    )
    np.testing.assert_allclose(scaled.frf, plain.frf * y[:, None] / u, rtol=1e-9)
    np.testing.assert_allclose(scaled.uncertainty, plain.uncertainty, rtol=1e-9)


def silent_history(samples=3001):
    target = BAND.limit_target(noise_target(samples))
    still = Playback(drive=np.zeros((2, samples)), response=np.zeros((2, samples)))
    return IterationHistory(target=target).after(still)


def test_playbacks_without_any_motion_return_the_identified_model():
    model = rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))
    settings = UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.SECANT)
    np.testing.assert_array_equal(secant_model(silent_history(), model, settings).frf, model.frf)


def test_the_identified_model_stays_the_anchor_whatever_came_of_it():
    model = wrong_model(swapped)
    settings = UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.SECANT)
    drive = BAND.limit_target(noise_target(4001, level=(0.01, 0.02)))
    played = Playback(drive=drive, response=BAND.limit_response(play(impulse_responses(), drive)))
    history = IterationHistory(target=BAND.limit_target(noise_target(4001))).after(played)
    once = secant_model(history, model, settings)
    again = secant_model(history, once, settings)
    assert np.max(np.abs(once.frf - model.frf)) > 0.0
    np.testing.assert_array_equal(again.frf, once.frf)


def test_the_covariance_of_the_identification_is_the_shape_of_the_prior():
    """The drive that was excited strongly keeps its column, the one that was hardly known learns its own."""
    frequency = line_frequencies(BLOCK, SAMPLE_RATE)
    lines = frequency.size
    covariance = np.broadcast_to(np.diag([1e-3, 1e3]).astype(np.complex128), (lines, 2, 2))
    truth_frf = frequency_response(impulse_responses())[1]
    model = replace(
        wrong_model(lambda _, frf: 1.5 * frf), uncertainty=ModelUncertainty(np.ones((lines, 2)), covariance)
    )
    drive = BAND.limit_target(noise_target(8001, level=(0.01, 0.01)))
    played = Playback(drive=drive, response=BAND.limit_response(play(impulse_responses(), drive)))
    history = IterationHistory(target=BAND.limit_target(noise_target(8001))).after(played)
    settings = UpdateSettings(
        band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.SECANT, secant=SecantSettings(prior_strength=3.0)
    )
    found = secant_model(history, model, settings).frf
    inside = (frequency > 6.0) & (frequency < 50.0)
    ratio = [np.median(np.abs(found[inside, j, j] / truth_frf[inside, j, j])) for j in range(2)]
    assert ratio[1] < 1.4 < ratio[0]


@pytest.mark.parametrize("samples", [300, 1237, 2001])
def test_a_target_shorter_than_two_blocks_or_of_odd_length_is_iterated(samples):
    found = errors(wrong_model(lambda _, frf: 1.3 * frf), kind=UpdateKind.SECANT, playbacks=4, samples=samples)
    assert found[-1] < 0.2 * found[0]


@pytest.mark.parametrize(
    "wrong", [{"forgetting": 0.0}, {"prior_strength": 0.0}, {"caution": -1.0}, {"regularisation": np.nan}]
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        SecantSettings(**wrong)


def test_a_prior_that_leaves_a_drive_out_is_refused():
    with pytest.raises(ValueError, match="without energy"):
        fit_secant(
            StepSpectra(np.zeros((2, 2, 2), complex), np.zeros((2, 2, 2), complex), np.zeros((2, 2))),
            np.ones((2, 2, 2), complex),
            identification_drive=np.broadcast_to(np.diag([1.0, 0.0]).astype(complex), (2, 2, 2)),
            prior_strength=0.3,
            response_weight=np.ones(2),
            drive_scale=np.ones(2),
            averages=40.0,
        )


def test_an_update_that_has_seen_the_earlier_steps_makes_the_same_bytes_as_one_that_has_not():
    rng = np.random.default_rng(12)
    model = wrong_model(swapped)
    history = IterationHistory(target=BAND.limit_target(rng.standard_normal((2, 8001))))
    settings = UpdateSettings(band=BAND, iteration_gain=np.full(2, 0.8), kind=UpdateKind.SECANT)
    bent = model
    for _ in range(4):
        drive, response = rng.standard_normal((2, 2, 8001))
        history = history.after(Playback(drive=drive, response=response))
        step = secant_update.next_drive(history, bent, settings)
        bent = step.model
        assert step.drive.tobytes() == secant_update.next_drive(history, model, settings).drive.tobytes()
    # Cut otherwise, or without the first playback, what was seen is of no use.
    other = settings.model_copy(update={"secant_overlap": 0.75})
    later = IterationHistory(target=history.target, playbacks=history.playbacks[1:])
    for told, asked in ((history, other), (later, settings)):
        assert (
            secant_update.next_drive(told, bent, asked).drive.tobytes()
            == secant_update.next_drive(told, model, asked).drive.tobytes()
        )
