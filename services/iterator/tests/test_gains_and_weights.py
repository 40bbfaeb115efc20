import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    CampaignSettings,
    ModelUncertainty,
    UpdateSettings,
    apply_inverse,
    control_band,
    rig_model,
    run_campaign,
)
from iterator.updates.gains import gain_at

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)


def run(settings, *, h=None, model=None, playbacks=4, target=None):
    h = impulse_responses() if h is None else h
    return run_campaign(
        lambda drive: play(h, drive),
        noise_target(4001) if target is None else target,
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)) if model is None else model,
        settings=CampaignSettings(update=settings, stop=StopCriteria(iterations=playbacks)),
    )


def test_a_schedule_sets_the_share_of_the_error_that_each_playback_corrects():
    settings = UpdateSettings(
        band=BAND, iteration_gain=np.array([1.0, 0.5]), kind=UpdateKind.BASIC_TWR, gain_schedule=(0.5, 0.8)
    )
    expected = np.ones(2)
    for iteration, share in zip(run(settings).iterations, (0.5, 0.8, 0.8, 0.8), strict=True):
        expected = expected * (1.0 - share * np.array([1.0, 0.5]))
        np.testing.assert_allclose(iteration.metrics.relative_rms_error, expected, rtol=0.02)


def test_a_curve_sets_it_for_each_frequency():
    curve = {"gain_curve_frequency": (20.0, 30.0), "gain_curve_share": ((1.0, 1.0), (0.25, 0.5))}
    settings = UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.BASIC_TWR, **curve)
    result = run(settings, playbacks=1)
    error = np.fft.rfft(result.target_in_band - result.iterations[0].response_in_band)
    target = np.fft.rfft(result.target_in_band)
    frequency = np.fft.rfftfreq(4001, 1.0 / SAMPLE_RATE)
    for low, high, expected in ((5.0, 18.0, (0.0, 0.0)), (32.0, 50.0, (0.75, 0.5))):
        part = (frequency > low) & (frequency < high)
        ratio = np.linalg.norm(error[:, part], axis=1) / np.linalg.norm(target[:, part], axis=1)
        np.testing.assert_allclose(ratio, expected, atol=0.02)


def test_gain_is_the_product_of_channel_curve_and_schedule():
    settings = UpdateSettings(
        band=BAND,
        iteration_gain=(0.5, 1.0),
        gain_schedule=(1.0, 0.5),
        gain_curve_frequency=(0.0, 10.0),
        gain_curve_share=((0.2, 1.0), (0.4, 1.0)),
    )
    found = gain_at(np.array([5.0, 50.0]), settings, playbacks=7)
    np.testing.assert_allclose(found, [[0.075, 0.5], [0.1, 0.5]])


@pytest.mark.parametrize(
    "wrong",
    [
        {"gain_schedule": (0.5, 1.2)},
        {"iteration_gain": np.array([0.0, 1.0])},
        {"iteration_gain": ()},
        {"gain_curve_frequency": (1.0,), "gain_curve_share": np.ones((1, 3))},
    ],
)
def test_gains_outside_zero_to_one_or_for_other_channels_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must|needs"):
        UpdateSettings(**{"band": BAND, "iteration_gain": np.ones(2), **wrong})


@pytest.mark.parametrize(
    ("frequency", "share"),
    [([1.0, 1.0], [[1.0], [1.0]]), ([1.0], [[0.0]]), ([1.0, 2.0], [[1.0]]), ([np.nan], [[1.0]])],
)
def test_an_impossible_gain_curve_is_refused(frequency, share):
    with pytest.raises(ValueError, match=r"must|needs"):
        UpdateSettings(band=BAND, iteration_gain=(1.0,), gain_curve_frequency=frequency, gain_curve_share=share)


def three_responses():
    """Two controlled responses and a third that hears both drives."""
    h = impulse_responses()
    return np.concatenate([h, 0.5 * h[:1] + 100.0 * h[1:]])


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("accept_segments", [False, True])
def test_a_watched_channel_is_measured_and_asks_nothing_of_the_drives(kind, accept_segments):
    h = three_responses()
    target = np.vstack([noise_target(4001), np.random.default_rng(4).standard_normal(4001) * 1e6])
    model = rig_model(
        *frequency_response(h), identified_band=(1.0, 70.0), response_weight=np.array([1 / 900.0, 1 / 40.0, 0.0])
    )
    settings = UpdateSettings(band=BAND, iteration_gain=np.full(3, 0.7), kind=kind, accept_segments=accept_segments)
    last = run(settings, h=h, model=model, playbacks=4, target=target).iterations[-1]
    np.testing.assert_allclose(last.metrics.relative_rms_error[:2], 0.3**4, rtol=0.05)
    assert last.metrics.relative_rms_error[2] > 0.9


def test_weights_that_leave_fewer_responses_than_drives_are_refused():
    h = three_responses()
    with pytest.raises(ValueError, match="1 responses have a weight above 0, for 2 drives"):
        rig_model(*frequency_response(h), identified_band=(1.0, 70.0), response_weight=np.array([1.0, 0.0, 0.0]))


def test_a_cautious_inverse_asks_less_where_the_model_is_doubtful_and_nothing_else_changes():
    h = three_responses()
    frequency, frf = frequency_response(h)
    doubtful = (frequency > 25.0) & (frequency < 35.0)
    psd = np.where(doubtful[:, None], 1.0, 1e-12) * np.array([1e10, 1e6, 1e6])
    uncertainty = ModelUncertainty(psd, np.broadcast_to(np.eye(2, dtype=complex), (frequency.size, 2, 2)))
    plain, cautious = (
        rig_model(frequency, frf, identified_band=(1.0, 70.0), uncertainty=uncertainty, caution=caution)
        for caution in (0.0, 1.0)
    )
    inside = (frequency > 2.0) & (frequency < 60.0)
    shrink = np.linalg.norm(cautious.inverse_frf[inside], axis=(1, 2)) / np.linalg.norm(
        plain.inverse_frf[inside], axis=(1, 2)
    )
    assert np.all(shrink[doubtful[inside]] < 0.9)
    np.testing.assert_allclose(shrink[~doubtful[inside]], 1.0, atol=1e-6)


def test_the_cautious_inverse_has_the_least_expected_error_over_the_rigs_that_the_uncertainty_allows():
    rng = np.random.default_rng(9)
    frequency, frf = frequency_response(three_responses())
    weight = np.array([1e-3, 1e-1, 1e-3])
    line = 60
    scatter = 0.3 * np.abs(frf[line]).mean(axis=1)
    uncertainty = ModelUncertainty(
        np.broadcast_to(scatter**2, (frequency.size, 3)),
        np.broadcast_to(np.array([[1.0, 0.5j], [-0.5j, 1.0]]), (frequency.size, 2, 2)),
    )
    root = np.linalg.cholesky(uncertainty.row_covariance[line])
    draws = rng.standard_normal((4000, 3, 2)) + 1j * rng.standard_normal((4000, 3, 2))
    rigs = frf[line] + scatter[:, None] * (draws / np.sqrt(2.0)) @ root.T

    def expected_error(caution):
        model = rig_model(
            frequency,
            frf,
            identified_band=(1.0, 70.0),
            response_weight=weight,
            uncertainty=uncertainty,
            caution=caution,
        )
        missed = weight[:, None] * (np.eye(3) - rigs @ model.inverse_frf[line]) / weight
        return np.mean(np.abs(missed) ** 2)

    best = expected_error(1.0)
    assert all(best < expected_error(caution) for caution in (0.0, 0.3, 3.0))


@pytest.mark.parametrize("wrong", [{"caution": 0.1}, {"regularisation": -1.0}])
def test_caution_without_uncertainty_and_negative_regularisation_are_refused(wrong):
    with pytest.raises(ValueError, match=r"caution|regularisation"):
        rig_model(*frequency_response(impulse_responses()), identified_band=(1.0, 70.0), **wrong)


def test_regularisation_lets_a_nearly_singular_line_be_inverted_gently():
    frequency, frf = frequency_response(impulse_responses())
    frf[:, 1] *= 1e-3
    weight = np.array([1e-5, 1e-3])
    plain, gentle = (
        rig_model(frequency, frf, identified_band=(1.0, 70.0), response_weight=weight, regularisation=regularisation)
        for regularisation in (0.0, 0.1)
    )
    wanted = BAND.limit_target(noise_target(2001))
    loud, quiet = (np.std(apply_inverse(model, wanted, band=BAND)) for model in (plain, gentle))
    assert quiet < 0.5 * loud
