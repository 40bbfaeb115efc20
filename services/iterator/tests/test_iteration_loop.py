import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import CampaignSettings, Outcome, UpdateSettings, control_band, iterate, rig_model, run_campaign

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)


def settings(kind, gain, iterations, **stop):
    return CampaignSettings(
        update=UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind),
        stop=StopCriteria(iterations=iterations, **stop),
    )


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize(("gain", "playbacks", "samples"), [(0.5, 13, 8000), (0.9, 4, 8001)])
def test_with_an_exact_model_of_a_linear_plant_the_error_shrinks_by_one_minus_q(kind, gain, playbacks, samples):
    h = impulse_responses()
    result = run_campaign(
        lambda drive: play(h, drive) + np.array([[3600.0], [20.0]]),
        noise_target(samples) + 500.0,
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=settings(kind, gain, playbacks),
    )
    assert result.outcome is Outcome.ITERATIONS_USED
    assert len(result.iterations) == playbacks
    assert (1.0 - gain) ** playbacks < 1.3e-4
    for iteration in result.iterations:
        expected = (1.0 - gain) ** iteration.number
        np.testing.assert_allclose(iteration.metrics.relative_rms_error, expected, rtol=0.01)
    assert result.best_iteration == playbacks


@pytest.mark.parametrize("samples", [200, 1001, 120_001])
def test_a_target_of_one_second_and_one_of_ten_minutes_come_down_alike(samples):
    h = impulse_responses()
    result = run_campaign(
        lambda drive: play(h, drive),
        noise_target(samples),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=settings(UpdateKind.SECANT, 0.9, 1),
    )
    assert result.iterations[0].drive.shape == (2, samples)
    # What the inverse asks for beyond the ends of a record cannot be played: of one second that is felt.
    np.testing.assert_allclose(result.iterations[0].metrics.relative_rms_error, 0.1, rtol=0.03)


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_three_responses_of_two_drives_come_down_alike_where_the_target_can_be_reached(kind):
    h = impulse_responses()
    h = np.concatenate([h, 5e-4 * h[:1] + 0.3 * h[1:]])
    target = BAND.limit_target(play(h, BAND.limit_target(noise_target(4001, level=(0.01, 0.02)))))
    weight = 1.0 / np.sqrt(np.mean(target**2, axis=1))
    result = run_campaign(
        lambda drive: play(h, drive),
        target,
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0), response_weight=weight),
        settings=CampaignSettings(
            update=UpdateSettings(band=BAND, iteration_gain=np.full(3, 0.9), kind=kind), stop=StopCriteria(iterations=4)
        ),
    )
    for iteration in result.iterations:
        np.testing.assert_allclose(iteration.metrics.overall_relative_rms_error, 0.1**iteration.number, rtol=0.03)


def test_channels_with_different_gains_converge_each_at_its_own_rate():
    h = impulse_responses()
    result = run_campaign(
        lambda drive: play(h, drive),
        noise_target(3001),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=CampaignSettings(
            update=UpdateSettings(band=BAND, iteration_gain=np.array([0.8, 0.3]), kind=UpdateKind.BASIC_TWR),
            stop=StopCriteria(iterations=3),
        ),
    )
    np.testing.assert_allclose(result.iterations[-1].metrics.relative_rms_error, [0.2**3, 0.7**3], rtol=0.01)


def hardening(h, target):
    """A rig that is stiffer at the target's level than at the low level of its identification."""
    level = np.sqrt(np.mean(target**2, axis=1, keepdims=True))

    def play_hardening(drive):
        linear = play(h, drive)
        return linear * (1.0 + 1.8 * np.tanh(np.abs(linear) / level))

    return play_hardening


def test_adaptive_modelling_converges_where_basic_twr_with_the_same_gain_ends_worse():
    h = impulse_responses()
    target = noise_target(8001)
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0))
    basic, adaptive = (
        run_campaign(hardening(h, target), target, model=model, settings=settings(kind, 0.8, 7)).iterations
        for kind in (UpdateKind.BASIC_TWR, UpdateKind.ADAPTIVE_MODELLING)
    )
    first, last = adaptive[0].metrics, adaptive[-1].metrics
    assert np.all(last.relative_rms_error < 0.12)
    assert np.all(last.relative_rms_error < 0.2 * first.relative_rms_error)
    assert np.all(basic[-1].metrics.relative_rms_error > 2.0 * last.relative_rms_error)


def test_reaching_the_asked_error_ends_the_iteration():
    h = impulse_responses()
    result = run_campaign(
        lambda drive: play(h, drive),
        noise_target(3000),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=settings(UpdateKind.BASIC_TWR, 0.5, 10, relative_rms_error=0.2),
    )
    assert result.outcome is Outcome.REACHED
    assert len(result.iterations) == 3


def test_a_model_with_the_wrong_sign_ends_as_diverged():
    h = impulse_responses()
    result = run_campaign(
        lambda drive: -play(h, drive),
        noise_target(3000),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=settings(UpdateKind.BASIC_TWR, 0.5, 10, divergence_ratio=1.2),
    )
    assert result.outcome is Outcome.DIVERGED
    assert len(result.iterations) == 2


def test_the_next_drive_is_not_made_before_it_is_asked_for():
    h = impulse_responses()
    played = []

    def record(drive):
        played.append(drive)
        return play(h, drive)

    steps = iterate(
        record,
        BAND.limit_target(noise_target(3000)),
        model=rig_model(*frequency_response(h), identified_band=(1.0, 70.0)),
        settings=settings(UpdateKind.ADAPTIVE_MODELLING, 0.5, 5),
    )
    assert played == []
    assert next(steps).number == 1
    assert len(played) == 1


def test_a_response_that_is_not_finite_or_too_short_is_refused():
    h = impulse_responses()
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0))
    for broken in (lambda drive: np.full_like(drive, np.nan), lambda drive: play(h, drive)[:, :-1]):
        with pytest.raises(ValueError, match="response"):
            run_campaign(broken, noise_target(3000), model=model, settings=settings(UpdateKind.BASIC_TWR, 0.5, 2))


def test_a_rig_that_works_in_the_memory_of_its_drive_and_answers_from_its_own_changes_nothing():
    h = impulse_responses()
    target = noise_target(3000)
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0))
    memory = np.empty((2, 3000))

    def careless(drive):
        memory[...] = play(h, drive)
        drive[...] = 0.0
        return memory

    kept, spoiled = (
        run_campaign(rig, target, model=model, settings=settings(UpdateKind.SECANT, 0.5, 3))
        for rig in (lambda drive: play(h, drive), careless)
    )
    for one, other in zip(kept.iterations, spoiled.iterations, strict=True):
        np.testing.assert_array_equal(one.drive, other.drive)
        np.testing.assert_array_equal(one.response, other.response)


def test_the_same_campaign_gives_the_same_bytes():
    h = impulse_responses()
    target = noise_target(4001)
    model = rig_model(*frequency_response(h), identified_band=(1.0, 70.0))
    first, second = (
        run_campaign(
            hardening(h, target), target, model=model, settings=settings(UpdateKind.ADAPTIVE_MODELLING, 0.5, 3)
        )
        for _ in range(2)
    )
    assert first.iterations[-1].drive.tobytes() == second.iterations[-1].drive.tobytes()
