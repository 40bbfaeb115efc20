"""Iterations in which other tools of the field were found to go wrong, with what they do where it can be shown."""

from dataclasses import replace

import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    IterationHistory,
    Playback,
    UpdateSettings,
    apply_inverse,
    control_band,
    corrected,
    estimate_correction,
    judge_response,
    rig_model,
    run_campaign,
)

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
UNGUARDED = {"smallest_correction": 1e-6, "largest_correction": 1e6, "weigh_by_coherence": False, "smooth_lines": False}


def exact_model():
    return rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0))


def settings(kind, gain=0.8, **more):
    return UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind, **more)


def campaign(model, update, *, playbacks=6, samples=6001):
    h = impulse_responses()
    return run_campaign(
        lambda drive: play(h, drive),
        noise_target(samples),
        model=model,
        settings=CampaignSettings(update=update, stop=StopCriteria(iterations=playbacks, **NO_BOUNDS)),
    )


def test_a_response_of_the_right_shape_at_half_the_level_is_half_wrong_and_does_no_damage():
    """Judged by a squared cosine with the target, which no scale changes, an iteration would end here as converged."""
    target = np.random.default_rng(1).standard_normal((2, 4001))
    found = judge_response(target, 0.5 * target)
    cosine = np.sum(target * 0.5 * target, axis=1) ** 2 / (np.sum(target**2, axis=1) * np.sum(0.25 * target**2, axis=1))
    np.testing.assert_allclose(cosine, 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.relative_rms_error, 0.5, rtol=1e-12)
    np.testing.assert_allclose(found.rms_response, 0.5, rtol=1e-12)
    assert found.damage_ratio.max() < 0.2


@pytest.mark.parametrize("samples", [3001, 3000])
def test_an_event_at_the_start_of_a_target_asks_for_nothing_at_its_end(samples):
    """Where the spectrum of the whole record is divided by the FRF, the acausal inverse wraps around."""
    delay = 40
    h = np.zeros((1, 1, 128))
    h[0, 0, delay] = 1.0
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0))
    target = np.zeros((1, samples))
    target[0, 20] = 1.0
    target = BAND.limit_target(target)
    frequency = np.fft.rfftfreq(samples, 1.0 / SAMPLE_RATE)
    wrapped = np.fft.irfft(np.fft.rfft(target) * np.exp(2j * np.pi * frequency * delay / SAMPLE_RATE), samples)
    end = slice(samples - 200, samples)
    drive = apply_inverse(model, target, band=BAND)
    assert drive.shape == target.shape
    assert np.max(np.abs(wrapped[:, end])) > 0.9 * np.max(np.abs(target))
    assert np.max(np.abs(drive[:, end])) < 1e-3 * np.max(np.abs(target))


def test_corrections_on_lines_that_are_not_coherent_do_not_pile_up():
    """Each correction multiplies the last: unguarded, noise alone puts an exact inverse wrong by several times."""
    generator = np.random.default_rng(2)
    target = BAND.limit_target(noise_target(6001))
    drive = apply_inverse(exact_model(), target, band=BAND)
    found = {}
    for name, correction in (("guarded", {}), ("plain", UNGUARDED)):
        model = exact_model()
        update = settings(UpdateKind.ADAPTIVE_MODELLING, **correction)
        for _ in range(8):
            noise = BAND.limit_response(generator.standard_normal(target.shape)) * [[900.0], [40.0]]
            history = IterationHistory(target=target).after(Playback(drive=drive, response=noise))
            model = corrected(model, estimate_correction(history, model, update))
        inside = (model.frequency > 3.0) & (model.frequency < 54.0)
        ratio = np.abs(model.inverse_frf[inside] / exact_model().inverse_frf[inside])
        found[name] = np.median(np.abs(np.log10(ratio)))
    assert found["plain"] > 0.7
    assert found["guarded"] < 0.02


def test_a_step_that_made_it_worse_is_not_the_start_of_the_next_one():
    """Stepping on from whatever was played last lets an iteration that had converged walk away again."""
    model = exact_model()
    # Too small by more than half in one channel: each step there overshoots by more than it corrects.
    wrong = replace(model, frf=model.frf * [[1.0], [0.35]], inverse_frf=model.inverse_frf / [1.0, 0.35])
    errors = {}
    for name, accept_segments in (("last", False), ("best", True)):
        result = campaign(wrong, settings(UpdateKind.BASIC_TWR, accept_segments=accept_segments), playbacks=7)
        errors[name] = [iteration.metrics.overall_relative_rms_error for iteration in result.iterations]
    assert errors["last"][-1] > 4.0 * errors["last"][0]
    assert errors["best"][-1] < 0.2 * errors["best"][0]


def test_the_best_drive_is_told_beside_the_last_one():
    """A report of the last drive alone hides that an earlier one was better; of the best alone, that it diverged."""
    model = exact_model()
    wrong = replace(model, frf=-model.frf, inverse_frf=-model.inverse_frf)
    result = campaign(wrong, settings(UpdateKind.BASIC_TWR), playbacks=3)
    assert result.best_iteration == 1
    assert len(result.iterations) == 3
    assert result.iterations[-1].metrics.overall_relative_rms_error > 3.0


def test_the_gain_of_a_response_belongs_to_its_error_and_not_to_a_drive():
    """Multiplied from the wrong side, a gain meant for a response scales a drive: only diagonal rigs do not notice."""
    h = impulse_responses()
    # Each drive moves mainly the other response.
    h = h[:, ::-1]
    update = settings(UpdateKind.BASIC_TWR).model_copy(update={"iteration_gain": (0.9, 0.3)})
    result = run_campaign(
        lambda drive: play(np.ascontiguousarray(h), drive),
        noise_target(6001),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=CampaignSettings(update=update, stop=StopCriteria(iterations=1)),
    )
    np.testing.assert_allclose(result.iterations[0].metrics.relative_rms_error, [0.1, 0.7], rtol=0.02)
