"""The forecast of a playback: exact on a linear rig, made before the playback, and honest about what it may miss."""

import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import CampaignSettings, ModelUncertainty, UpdateSettings, iterate, judge_response, rig_model

from .arc_rig import BAND, IDENTIFIED, LEVEL, drive, exact_model
from .linear_plants import frequency_response, impulse_responses, play

H = impulse_responses()
TARGET = BAND.limit_target(play(H, drive(seed=5, seconds=25.0, level=LEVEL, highest=36.0)))


def run(rig, *, model=None, iterations=4, gain=0.8, kind=UpdateKind.SECANT, **options):
    update = UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind)
    settings = CampaignSettings(update=update, stop=StopCriteria(iterations=iterations))
    return list(iterate(rig, TARGET, model=model or exact_model(), settings=settings, **options))


def test_a_linear_rig_with_an_exact_model_does_what_was_foretold():
    for step in run(lambda u: play(H, u)):
        assert np.all(step.forecast.missed < 2e-3)
        np.testing.assert_allclose(step.forecast.metrics.peak_ratio, step.metrics.peak_ratio, rtol=0.01)
        found = judge_response(TARGET, step.forecast.response)
        assert step.forecast.metrics.overall_relative_rms_error == found.overall_relative_rms_error


def test_a_forecast_is_made_before_its_playback():
    events = []

    def rig(u):
        events.append("played")
        return play(H, u)

    steps = run(rig, iterations=2, on_forecast=lambda forecast: events.append(forecast.missed))
    assert events == [None, "played", None, "played"]
    assert all(step.forecast.missed is not None for step in steps)


@pytest.mark.parametrize("seed", range(5))
def test_the_uncertainty_covers_what_noise_and_a_wrong_model_make_of_a_playback(seed):
    rng = np.random.default_rng(seed)
    wrong = rig_model(*frequency_response(H * (1.0 + 0.2 * rng.standard_normal((2, 2, 1)))), identified_band=IDENTIFIED)
    steps = run(
        lambda u: play(H, u) + 0.02 * rms(TARGET)[:, None] * rng.standard_normal(u.shape), model=wrong, iterations=6
    )
    for step in steps[1:]:
        assert np.all(step.forecast.missed < 3.0 * step.forecast.uncertainty + 0.01)
    assert np.all(np.isnan(steps[0].forecast.uncertainty))


def test_the_first_uncertainty_is_what_the_identification_left_unexplained():
    frequency, frf = frequency_response(H)
    spacing = frequency[1] - frequency[0]
    inside = (frequency >= IDENTIFIED[0]) & (frequency <= IDENTIFIED[1])
    level = np.array([3.0, 0.2])
    psd = np.where(inside[:, None], level**2 / (spacing * inside.sum()), 0.0)
    covariance = np.tile(np.eye(2, dtype=complex) * 1e-9, (frequency.size, 1, 1))
    model = rig_model(frequency, frf, identified_band=IDENTIFIED, uncertainty=ModelUncertainty(psd, covariance))
    (step,) = run(lambda u: play(H, u), model=model, iterations=1)
    np.testing.assert_allclose(step.forecast.uncertainty, level / rms(TARGET), rtol=1e-12)
