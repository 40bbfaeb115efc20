from dataclasses import replace

import numpy as np

from duralab_settings import UpdateKind
from iterator import ModelUncertainty, UpdateSettings, control_band, predict_convergence, rig_model

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses

SETTINGS = UpdateSettings(
    band=control_band(2.0, 60.0, sample_rate=SAMPLE_RATE),
    iteration_gain=np.full(2, 0.8),
    kind=UpdateKind.BASIC_TWR,
    gain_schedule=(0.5, 1.0),
)


def exact_model(**more):
    return rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0), **more)


def test_an_exact_model_shrinks_the_error_by_one_minus_the_scheduled_gain():
    for playbacks, expected in ((0, 0.6), (1, 0.2), (5, 0.2)):
        found = predict_convergence(exact_model(), SETTINGS, playbacks=playbacks)
        np.testing.assert_allclose(found.spectral_radius, expected, rtol=1e-9)
        assert found.diverging().size == 0


def test_lines_at_which_the_inverse_asks_the_wrong_way_are_named():
    model = exact_model()
    wrong = (model.frequency > 20.0) & (model.frequency < 30.0)
    turned = replace(model, inverse_frf=np.where(wrong[:, None, None], -1.0, 1.0) * model.inverse_frf)
    found = predict_convergence(turned, SETTINGS, playbacks=1)
    np.testing.assert_array_equal(found.diverging(), model.frequency[wrong])


def test_the_deviation_is_that_of_rigs_drawn_from_the_uncertainty():
    rng = np.random.default_rng(2)
    lines, line = exact_model().frequency.size, 60
    covariance = np.array([[2.0, 0.6j], [-0.6j, 0.5]])
    psd = np.array([1e6, 1e2])
    uncertainty = ModelUncertainty(
        np.broadcast_to(psd, (lines, 2)), np.broadcast_to(covariance, (lines, 2, 2)).astype(complex)
    )
    model = exact_model(uncertainty=uncertainty)
    found = predict_convergence(model, SETTINGS, playbacks=1)
    at = int(np.flatnonzero(found.frequency == model.frequency[line])[0])
    noise = (rng.standard_normal((20_000, 2, 2)) + 1j * rng.standard_normal((20_000, 2, 2))) / np.sqrt(2.0)
    root = np.linalg.cholesky(covariance).T
    rigs = np.sqrt(psd)[:, None] * noise @ root
    change = 0.8 * root @ model.inverse_frf[line] @ rigs @ np.linalg.inv(root)
    np.testing.assert_allclose(
        found.deviation[at], np.sqrt(np.mean(np.sum(np.abs(change) ** 2, axis=(1, 2)))), rtol=0.03
    )
