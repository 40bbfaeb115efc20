"""What is played is the solution of the equations, by scipy's integrators; Drake's own are in test_drake_engine."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig_sim.compile import Method

RATE = 1000.0


def moving(rig, samples):
    """Return a drive (drives, samples) that begins at zero and is linear between samples, as the player takes it."""
    time = np.arange(samples) / RATE
    begin = np.minimum(time / 0.05, 1.0)
    channels = rig.specimen.drives
    frequencies = iter((6.0, 9.0, 12.0, 7.0, 10.0, 13.0))
    return np.array(
        [
            15.0 * begin if c.unit == "m/s" else 0.04 * c.maximum * begin * np.sin(2 * np.pi * next(frequencies) * time)
            for c in channels
        ]
    )


def at(drive, time):
    position = min(time * RATE, drive.shape[1] - 1.0)
    index = min(int(position), drive.shape[1] - 2)
    return drive[:, index] + (position - index) * (drive[:, index + 1] - drive[:, index])


def play(rig, drive, substeps, method):
    return rig.compiled.play(rig.rest, drive, sample_interval=1.0 / RATE, substeps=substeps, method=method)


@pytest.fixture(scope="module")
def solved(quiet_rig):
    """The responses (6, samples) by a method of order 8 with an error control far tighter than the player's step."""
    samples = 161
    drive = moving(quiet_rig, samples)
    state, states = quiet_rig.rest.copy(), []
    # Sample by sample: the drive has a kink at each, over which no method of high order should step.
    for sample in range(samples - 1):
        states.append(state)
        solution = solve_ivp(
            lambda t, y: quiet_rig.compiled.derivative(y, at(drive, t)),
            (sample / RATE, (sample + 1) / RATE),
            state,
            method="DOP853",
            rtol=1e-9,
            atol=1e-11,
        )
        state = solution.y[:, -1]
    responses = [quiet_rig.compiled.outputs(s, drive[:, k])[:6] for k, s in enumerate(states)]
    return drive, np.array(responses).T


def error(responses, expected, static):
    return np.sqrt(np.mean((responses - expected) ** 2, axis=1)) / np.sqrt(np.mean((expected - static) ** 2, axis=1))


def test_the_player_solves_its_equations_to_a_thousandth(quiet_rig, solved):
    drive, expected = solved
    specimen = quiet_rig.specimen
    responses = play(quiet_rig, drive, specimen.substeps, specimen.integrator).outputs[:6]
    assert error(responses, expected, quiet_rig.static_response[:, None]).max() < 1e-3


def test_the_classical_methods_error_falls_with_about_the_fourth_power_of_the_step(quiet_rig, solved):
    drive, expected = solved
    static = quiet_rig.static_response[:, None]
    # Where friction reverses and dampers change direction, rates have kinks: below about 1e-5 they are what is left.
    substeps = {"front_axle": (2, 4), "predecessor": (1, 2)}[quiet_rig.specimen.name]
    coarse, fine = (
        error(play(quiet_rig, drive, n, Method.RUNGE_KUTTA_4).outputs[:6], expected, static).max() for n in substeps
    )
    assert 3.4 < np.log2(coarse / fine) < 4.6
