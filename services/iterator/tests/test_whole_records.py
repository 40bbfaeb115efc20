"""Steps at the lines of their whole records: what a fit to them finds that averaged blocks blur."""

from dataclasses import replace

import numpy as np
import pytest

from duralab_settings import SecantSettings, StopCriteria, UpdateKind
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    IterationHistory,
    Playback,
    UpdateSettings,
    control_band,
    rig_model,
    run_campaign,
)
from iterator.model import DriveTerm, StepBlocks, WholeRecords, averaged_steps, seen_steps

RATE, BLOCK, SAMPLES = 200.0, 128, 4000
FREQUENCY = np.fft.rfftfreq(BLOCK, 1.0 / RATE)
GAIN = np.array([[2.0, 0.5], [-0.3, 1.0]])
CHANGED, BY_SPEED = np.array([[0.4, 0.1], [0.2, -0.3]]), np.array([[0.02, -0.01], [0.005, 0.03]])
IDENTIFIED = np.broadcast_to(GAIN, (FREQUENCY.size, 2, 2)).astype(complex)
MODEL = rig_model(FREQUENCY, IDENTIFIED, identified_band=(1.0, 60.0))
WEIGHT = np.ones(2)


def blocks(terms=()):
    return StepBlocks(block_samples=BLOCK, overlap=0.5, sample_rate=RATE, first=1, last=30, terms=terms)


def drive_at_rest_at_its_ends(seed, *, corner=6.0, samples=SAMPLES):
    """Return two drives whose spectra fall steeply, so that a line of a block is not like its neighbours."""
    frequency = np.fft.rfftfreq(samples, 1.0 / RATE)
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal((2, samples)), axis=1)
    drive = np.fft.irfft(lines / (1.0 + (frequency / corner) ** 4) * (frequency < 70.0), n=samples, axis=1)
    return drive * np.clip(np.minimum(np.arange(samples), np.arange(samples)[::-1]) / RATE, 0.0, 1.0) ** 2


def response(drive, *, square=0.0):
    """Return the response of a rig that differs from the model by a gain and a share of the speed."""
    length = 2 * drive.shape[1]
    lines = np.fft.rfft(drive, n=length, axis=1) * 2j * np.pi * np.fft.rfftfreq(length, 1.0 / RATE)
    speed = np.fft.irfft(lines, n=length, axis=1)[:, : drive.shape[1]]
    return (GAIN + CHANGED) @ drive + BY_SPEED @ speed + square * drive**2


def history_of(*drives, **more):
    played = tuple(Playback(drive=drive, response=response(drive, **more)) for drive in drives)
    return IterationHistory(target=np.ones_like(drives[0]), playbacks=played)


def fitted(spectra):
    return np.linalg.solve(spectra.drive.swapaxes(1, 2), spectra.response_with_drive.swapaxes(1, 2)).swapaxes(1, 2)


def truth(lines):
    return GAIN + CHANGED + 2j * np.pi * FREQUENCY[lines, None, None] * BY_SPEED


def test_a_difference_that_grows_with_frequency_is_found_exactly_and_averaged_blocks_blur_it():
    steps = seen_steps(history_of(drive_at_rest_at_its_ends(1)), blocks())
    lines = np.arange(1, 31)
    of_records = fitted(WholeRecords(MODEL, IDENTIFIED).averaged(steps, forgetting=0.7, response_weight=WEIGHT))
    of_blocks = fitted(averaged_steps(steps, forgetting=0.7, response_weight=WEIGHT))
    error = np.abs(of_records - truth(lines)).max(axis=(1, 2))
    assert error.max() < 2e-3 * np.abs(truth(lines)).max()
    assert np.abs(of_blocks - truth(lines)).max() > 10.0 * error.max()


def test_what_the_found_matrix_leaves_of_the_responses_is_nothing():
    steps = seen_steps(history_of(drive_at_rest_at_its_ends(2)), blocks())
    spectra = WholeRecords(MODEL, IDENTIFIED).averaged(steps, forgetting=0.7, response_weight=WEIGHT)
    of_blocks = averaged_steps(steps, forgetting=0.7, response_weight=WEIGHT)
    left, left_by_blocks = (np.mean(each.unexplained(fitted(each)) / each.response) for each in (spectra, of_blocks))
    assert left < 1e-4
    assert left < 0.05 * left_by_blocks


def test_squares_are_found_beside_the_drives():
    terms = (DriveTerm.SQUARE,)
    history = history_of(*(drive_at_rest_at_its_ends(seed, corner=20.0) for seed in (3, 4)), square=0.7)
    steps = seen_steps(history, blocks(terms))
    spectra = WholeRecords(MODEL, IDENTIFIED).averaged(steps, forgetting=1.0, response_weight=WEIGHT)
    # The windows of the first lines end above 0 Hz, where a response in a band has nothing.
    found = fitted(spectra)[3:, :, 2:]
    np.testing.assert_allclose(found, np.broadcast_to(0.7 * np.eye(2), found.shape), atol=0.005)


def test_a_step_counts_by_its_age_and_not_by_its_size():
    first, second = drive_at_rest_at_its_ends(5), drive_at_rest_at_its_ends(6)
    found = []
    for size in (1.0, 1e-3):
        history = history_of(first, first + size * second)
        moved = (history.playbacks[0], replace(history.playbacks[1], response=response(first) + size * (2.0 * second)))
        steps = seen_steps(replace(history, playbacks=moved), blocks())
        found.append(fitted(WholeRecords(MODEL, IDENTIFIED).averaged(steps, forgetting=0.3, response_weight=WEIGHT)))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6, atol=1e-9)


def test_a_step_of_zeros_has_no_weight():
    drive = drive_at_rest_at_its_ends(7)
    once, twice = history_of(drive), history_of(drive, drive)
    records = WholeRecords(MODEL, IDENTIFIED)
    alone = records.averaged(seen_steps(once, blocks()), forgetting=0.5, response_weight=WEIGHT)
    both = records.averaged(seen_steps(twice, blocks()), forgetting=0.5, response_weight=WEIGHT)
    np.testing.assert_allclose(fitted(both), fitted(alone), rtol=1e-9)


@pytest.mark.parametrize(("samples", "expected"), [(4000, 1.41 * 3 * 4000 / 128), (400, 1.41 * 20)])
def test_the_independent_lines_are_those_of_the_window_times_the_steps(samples, expected):
    drives = [drive_at_rest_at_its_ends(seed, samples=samples) for seed in (8, 9)]
    steps = seen_steps(history_of(*drives), blocks())
    assert WholeRecords.averages(steps[:1], forgetting=0.5) == pytest.approx(expected)
    assert WholeRecords.averages(steps, forgetting=0.5) == pytest.approx(expected * 1.5**2 / 1.25)


def resonance(frequency, at, damping=0.2):
    return 1.0 / (1.0 - (frequency / at) ** 2 + 2j * damping * frequency / at)


def play_resonance(drive, at):
    """Return the response of two oscillators, each to its drive and half of the other one's."""
    length = 4 * drive.shape[1]
    lines = np.fft.rfft(np.array([[1.0, 0.5], [0.5, 1.0]]) @ drive, n=length, axis=1)
    frf = resonance(np.fft.rfftfreq(length, 1.0 / RATE), at)
    return np.fft.irfft(frf * lines, n=length, axis=1)[:, : drive.shape[1]]


def test_a_resonance_that_moved_is_followed_faster():
    band = control_band(2.0, 30.0, sample_rate=RATE)
    frf = resonance(FREQUENCY, 11.0)[:, None, None] * np.array([[1.0, 0.5], [0.5, 1.0]])
    model = rig_model(FREQUENCY, frf, identified_band=(1.0, 40.0))
    target = band.limit_target(play_resonance(drive_at_rest_at_its_ends(10, corner=20.0), 13.0))
    errors = {}
    for whole_record in (False, True):
        secant = SecantSettings(forgetting=0.3, prior_strength=0.1, caution=0.5, whole_record=whole_record)
        update = UpdateSettings(band=band, iteration_gain=np.ones(2), kind=UpdateKind.SECANT, secant=secant)
        result = run_campaign(
            lambda drive: play_resonance(drive, 13.0),
            target,
            model=model,
            settings=CampaignSettings(update=update, stop=StopCriteria(iterations=5, **NO_BOUNDS)),
        )
        errors[whole_record] = [each.metrics.overall_relative_rms_error for each in result.iterations]
    assert errors[True][-1] < 0.5 * errors[False][-1]
    assert errors[True][-1] < 0.005
