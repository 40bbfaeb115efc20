"""A rig whose lever moves on an arc: one response follows from the square of another drive."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from duralab_settings import LimitPolicy, StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import (
    CampaignSettings,
    DriveLimits,
    IterationHistory,
    Playback,
    StepStart,
    UpdateSettings,
    control_band,
    predict,
    rig_model,
    run_campaign,
)
from iterator.model import StepSpectra, drive_without
from iterator.updates import controlled_model, secant_update, whole_model
from iterator.updates.drive_squares import drive_for_squares
from iterator.updates.secant_fit import fit_secant

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

# Squares of the drives of a target of 6 to 20 Hz lie below 14 Hz and from 12 to 40 Hz: nearly all within the band.
BAND = control_band(1.5, 54.0, sample_rate=SAMPLE_RATE, lower_flank=0.5, upper_flank=6.0)
_TARGET_FILTER = butter(4, (6.0, 20.0), "bandpass", fs=SAMPLE_RATE, output="sos")
ARC = 2e5
"""Of the first drive in the second response, 1/m²: it adds two fifths of that response's target."""
SETTINGS = UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.SECANT, accept_segments=True)


def on_an_arc(drive):
    return play(impulse_responses(), drive) + np.array([[0.0], [ARC]]) * np.square(drive[0])


def linear_model():
    return rig_model(*frequency_response(impulse_responses()), identified_band=(0.5, 70.0))


def narrow_target(samples):
    return 3.0 * sosfiltfilt(_TARGET_FILTER, noise_target(samples))


def errors(rig, *, squares, playbacks=5):
    settings = SETTINGS.model_copy(update={"squares": squares})
    result = run_campaign(
        rig,
        narrow_target(16001),
        model=linear_model(),
        settings=CampaignSettings(update=settings, stop=StopCriteria(iterations=playbacks)),
    )
    return np.array([iteration.metrics.overall_relative_rms_error for iteration in result.iterations])


def test_what_the_square_of_a_drive_does_is_learned():
    learned, linear = errors(on_an_arc, squares=True), errors(on_an_arc, squares=False)
    assert learned[0] == linear[0] > 0.25
    assert learned[3] < 0.05 * learned[0]
    assert learned[3] < 0.2 * linear[3]


def test_a_linear_rig_is_iterated_as_if_nothing_had_squares():
    def noisy(drive):
        return play(impulse_responses(), drive) + np.random.default_rng(3).normal(0.0, 2.0, drive.shape)

    np.testing.assert_allclose(errors(noisy, squares=True), errors(noisy, squares=False), rtol=0.05)


def spectra_of(drives, responses):
    """Exact averages over blocks: shape of both (blocks, lines, channels)."""
    blocks = drives.shape[0]
    return StepSpectra(
        np.einsum("bli,blj->lij", responses, drives.conj()) / blocks,
        np.einsum("bli,blj->lij", drives, drives.conj()) / blocks,
        np.mean(np.abs(responses) ** 2, axis=0),
    )


def fitted(spectra, truth, *, averages):
    lines = truth.shape[0]
    return fit_secant(
        spectra,
        truth,
        identification_drive=np.broadcast_to(np.eye(2, dtype=np.complex128), (lines, 2, 2)),
        prior_strength=1.0,
        response_weight=np.ones(truth.shape[1]),
        drive_scale=np.array([0.1, 2.0]),
        averages=averages,
    )


def complex_noise(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def test_squares_that_explain_a_response_are_fitted_and_what_they_do_not_touch_stays():
    rng = np.random.default_rng(4)
    lines, blocks = 30, 200
    truth, arc = complex_noise(rng, lines, 3, 2), np.zeros((lines, 3, 2), dtype=np.complex128)
    arc[:, 1, 0] = 5.0
    inputs = complex_noise(rng, blocks, lines, 4)
    noise = 0.01 * complex_noise(rng, blocks, lines, 3)
    responses = np.einsum("lij,blj->bli", np.concatenate((truth, arc), axis=2), inputs) + noise
    fit = fitted(spectra_of(inputs, responses), truth, averages=float(blocks))
    # The prior of the squares keeps 3 % of them.
    np.testing.assert_allclose(fit.square_frf[:, 1, 0], 5.0 / 1.03, rtol=0.02)
    assert np.max(np.abs(fit.square_frf[:, [0, 2]])) < 0.01
    np.testing.assert_allclose(fit.frf, truth, atol=0.2)


@pytest.mark.parametrize("blocks", [3, 12, 60])
def test_noise_is_not_taken_for_squares_however_few_blocks_there_are(blocks):
    rng = np.random.default_rng(5)
    lines = 200
    truth = complex_noise(rng, lines, 2, 2)
    inputs = complex_noise(rng, blocks, lines, 4)
    responses = np.einsum("lij,blj->bli", truth, inputs[:, :, :2]) + complex_noise(rng, blocks, lines, 2)
    fit = fitted(spectra_of(inputs, responses), truth, averages=blocks / 2.4)
    share = np.abs(fit.square_frf) ** 2
    assert np.mean(share > 0.0) < 0.1
    assert np.mean(share) < 0.01


def test_the_fit_with_squares_does_not_depend_on_units():
    rng = np.random.default_rng(6)
    truth, inputs = complex_noise(rng, 9, 2, 2), complex_noise(rng, 60, 9, 4)
    responses = np.einsum("lij,blj->bli", complex_noise(rng, 9, 2, 4), inputs)
    plain = fitted(spectra_of(inputs, responses), truth, averages=60.0)
    unit = np.array([1e-3, 1e4])
    both = np.concatenate((unit, unit**2))
    scaled = fit_secant(
        spectra_of(inputs * both, responses),
        truth / unit,
        identification_drive=np.broadcast_to(np.diag(unit**2).astype(np.complex128), (9, 2, 2)),
        prior_strength=1.0,
        response_weight=np.ones(2),
        drive_scale=np.array([0.1, 2.0]) * unit,
        averages=60.0,
    )
    np.testing.assert_allclose(scaled.frf * unit, plain.frf, rtol=1e-8)
    np.testing.assert_allclose(scaled.square_frf * unit**2, plain.square_frf, rtol=1e-8)


def test_the_step_is_corrected_for_what_its_own_squares_will_do():
    model = linear_model()
    square_frf = np.zeros_like(model.frf)
    square_frf[:, 1, 0] = ARC
    target = BAND.limit_target(narrow_target(4001))
    rest = np.zeros_like(target)
    start = StepStart(model, drive=rest, response=rest, step_gain=None)
    linear = secant_update.next_drive(IterationHistory(target), model, SETTINGS).drive
    corrected = drive_for_squares(linear, start, square_frf=square_frf, band=BAND)

    def missed(drive):
        arc = np.array([[0.0], [ARC]]) * np.square(drive[0])
        return rms(target - predict(model, drive, band=BAND) - BAND.limit_response(arc))[1]

    # The fixed point converges by about 0.6 a look; three are taken.
    assert missed(corrected) < 0.3 * missed(linear)
    expected = linear
    for _ in range(3):
        expected = drive_without(model, np.square(expected), by=square_frf, band=BAND, drive=linear)
    np.testing.assert_allclose(corrected, expected, atol=1e-12 * np.abs(expected).max())


def test_a_correction_that_would_run_away_is_left_out():
    model = linear_model()
    target = BAND.limit_target(narrow_target(4001))
    rest = np.zeros_like(target)
    start = StepStart(model, drive=rest, response=rest, step_gain=None)
    linear = secant_update.next_drive(IterationHistory(target), model, SETTINGS).drive
    # Each drive's own square, many times what the drive itself does: no drive makes this target.
    absurd = np.zeros_like(model.frf)
    absurd[:, 0, 0] = 1e9
    np.testing.assert_array_equal(drive_for_squares(linear, start, square_frf=absurd, band=BAND), linear)


def test_squares_are_not_reckoned_with_while_a_drive_stands_at_its_limits():
    """What is played then is not what was asked for: its square says nothing."""
    free, held = (knows_squares(peak) for peak in (1.0, 0.012))
    assert free == [False, True, True]
    assert held == [False, False, False]


def knows_squares(peak):
    """Whether the model of each playback knows squares, under limits of so many metres."""
    limits = DriveLimits(
        ("a", "b"), ("m", "m"), np.full(2, -peak), np.full(2, peak), slew_limit=np.zeros(2), sample_rate=SAMPLE_RATE
    )
    stop = StopCriteria(iterations=3)
    settings = CampaignSettings(update=SETTINGS, stop=stop, limit_policy=LimitPolicy.PROJECT, largest_overrun=10.0)
    result = run_campaign(on_an_arc, narrow_target(8001), model=linear_model(), settings=settings, limits=limits)
    return [step.model.square_frf is not None for step in result.iterations]


def test_watched_responses_have_no_part_in_the_squares():
    model = replace(linear_model(), square_frf=np.ones((257, 2, 2), dtype=np.complex128))
    controlled = np.array([False, True])
    kept = controlled_model(model, controlled)
    assert kept.square_frf.shape == (257, 1, 2)
    whole = whole_model(kept, identified=linear_model(), controlled=controlled)
    np.testing.assert_array_equal(whole.square_frf[:, 0], 0.0)
    np.testing.assert_array_equal(whole.square_frf[:, 1], 1.0)


def test_drives_that_do_not_move_have_no_squares():
    still = Playback(drive=np.zeros((2, 3001)), response=np.zeros((2, 3001)))
    history = IterationHistory(target=BAND.limit_target(narrow_target(3001))).after(still)
    found = secant_update.secant_model(history, linear_model(), SETTINGS)
    assert not np.any(found.square_frf)
