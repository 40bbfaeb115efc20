"""Transients that hardly decay within a block, on rigs with and without noise."""

from dataclasses import replace

import numpy as np
import pytest
from known_plants import lightly_damped, periodic_experiment, respond
from scipy import signal

from duralab_settings import EstimatorKind
from identifier import WarningCode, estimate
from identifier.estimators.periodicity import PeriodicityCheck
from identifier.estimators.slow_transients import SlowTransients
from identifier.uncertainty import separate_distortion, separated_verdicts

BLOCK = 1024


def experiment(*, time_constant, noise=0.0, periods=2, experiments=6, delay=1):
    """Return a response, one row, with a decaying oscillation in each experiment; time constant in blocks."""
    drive, layout = periodic_experiment(delay=delay, periods=periods, drives=1, experiments=experiments)
    generator = np.random.default_rng(7)
    time = np.arange((delay + periods) * BLOCK) / BLOCK
    phases = 2.0 * np.pi * generator.random(experiments)
    decays = [np.exp(-time / time_constant) * np.cos(40.0 * np.pi * time + phase) for phase in phases]
    response = drive / np.std(drive) + np.concatenate(decays)
    return response + noise * generator.standard_normal(response.shape), layout


def warnings_of(response, layout):
    check = PeriodicityCheck(layout, responses=response.shape[0])
    check.add(response)
    return check.warnings()


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("time_constant", [1.5, 2.7, 6.0])
@pytest.mark.parametrize("periods", [2, 5])
def test_a_transient_is_named_though_its_time_constant_is_longer_than_a_block(time_constant, noise, periods):
    response, layout = experiment(time_constant=time_constant, noise=noise, periods=periods)
    (warning,) = warnings_of(response, layout)
    assert (warning.code, warning.channel) == (WarningCode.TRANSIENT, 0)
    # The two periods differ by this much of the oscillation, 20 whole cycles in each.
    time = 1.0 + np.arange(BLOCK) / BLOCK
    left = np.exp(-time / time_constant) * (1.0 - np.exp(-1.0 / time_constant))
    later = [response[0, capture.start + BLOCK : capture.start + 2 * BLOCK] for capture in layout.captures]
    expected = np.sqrt(0.5 * np.mean(left**2) / np.mean(np.square(later)))
    assert warning.size == pytest.approx(expected, rel=0.5 if noise else 0.01)


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_a_transient_that_ends_with_the_delay_is_none_however_much_noise_there_is(noise):
    response, layout = experiment(time_constant=0.2, noise=noise)
    spoilt = np.mean((response[:, BLOCK // 2 : BLOCK] - response[:, 3 * BLOCK // 2 : 2 * BLOCK]) ** 2)
    assert noise > 0.05 or spoilt > 1.2 * 2.0 * noise**2  # it is there to see, in the delay block
    assert warnings_of(response, layout) == ()


def coloured(generator, shape, colour):
    """Noise of unit variance: white, or of a mode with 3 % or 0.5 % damping that it keeps moving."""
    noise = generator.standard_normal((shape[0], shape[1] + 4000))
    if colour:
        angle, radius = 0.2, np.exp(-colour * 0.2)
        noise = signal.lfilter([1.0], [1.0, -2.0 * radius * np.cos(angle), radius**2], noise, axis=1)
    return noise[:, 4000:] / np.std(noise[:, 4000:])


@pytest.mark.parametrize("colour", [0.0, 0.03, 0.005])
@pytest.mark.parametrize("responses", [1, 6])
def test_a_settled_noisy_rig_has_none(colour, responses):
    generator = np.random.default_rng(21)
    found = judged = 0
    for periods in (2, 3, 8):
        for experiments in (2, 4, 12):
            drive, layout = periodic_experiment(
                block=256, delay=1, periods=periods, drives=1, experiments=experiments, seed=2
            )
            for noise in (0.01, 0.05, 0.3, 1.0):
                for _ in range(10):
                    disturbed = coloured(generator, (responses, drive.shape[1]), colour)
                    response = drive + noise * np.std(drive) * disturbed
                    check = SlowTransients()
                    for capture in layout.captures:
                        stretch = slice(capture.start - 256, capture.start + 512)
                        check.add(response[:, stretch].reshape(responses, 3, 256))
                    found += np.count_nonzero(check.difference_power(responses))
                    judged += responses
    # Of 360 or 2160 judgements; one in 10,000 may be wrong by chance, which none of these is.
    assert judged == 360 * responses
    assert found == 0


def test_on_a_linear_rig_that_is_not_settled_every_verdict_tells_of_the_transient():
    drive, layout = periodic_experiment(delay=1, periods=2, experiments=8)
    response = respond(drive, lightly_damped(0.002))  # 4.0 and 2.1 s: 3.9 and 2.1 blocks
    found = estimate(EstimatorKind.H1, drive, response, layout)
    unsettled = {warning.channel for warning in found.warnings if warning.code is WarningCode.TRANSIENT}
    verdicts = separated_verdicts(
        separate_distortion(drive, response, layout), responses=("a", "b"), unsettled=unsettled
    )
    assert any(sentence.startswith("Nonlinear") for sentence in verdicts)
    assert all("a transient that is left" in sentence for sentence in verdicts)


def test_in_another_response_of_the_same_rig_the_ratio_alone_tells():
    clear, layout = experiment(time_constant=2.0, experiments=6)
    generator = np.random.default_rng(5)
    # A disturbance in one of six experiments: the captures do not agree.
    disturbed = np.repeat([0.0, 0.0, 0.25, 0.0, 0.0, 0.0], 3 * BLOCK)
    hidden = clear + disturbed * generator.standard_normal(clear.shape)
    assert warnings_of(hidden, layout) == ()
    assert [warning.channel for warning in warnings_of(np.vstack([clear, hidden]), layout)] == [0, 1]


def test_three_whole_periods_are_needed_and_two_captures():
    response, layout = experiment(time_constant=3.0)
    assert warnings_of(response, layout)
    faded = replace(layout, fade_samples=BLOCK // 2 + 1)
    assert warnings_of(response, faded) == ()
    assert warnings_of(*experiment(time_constant=3.0, periods=1)) == ()
    assert warnings_of(*experiment(time_constant=3.0, experiments=1)) == ()
    longer, layout = experiment(time_constant=3.0, periods=3)
    assert warnings_of(longer, replace(layout, fade_samples=BLOCK // 2 + 1))
