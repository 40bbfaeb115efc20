"""A mode sampled by its matrix exponential against the differential equation and the closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig_sim.structure.modal_model import ModalModel

RATE = 512.0
MODEL = ModalModel(
    frequency=np.array([1.2, 31.07, 31.53]),
    damping=np.array([0.02, 0.003, 0.002]),
    at_drives=np.array([[0.4, -0.8, 1.0], [0.2, 0.9, 1.1]]),
    at_responses=np.array([[0.4, -0.8, 1.0], [0.1, 0.5, -0.2], [0.3, 0.2, 0.7]]),
)


def test_sampling_is_exact_for_a_force_that_is_linear_between_samples():
    force = np.random.default_rng(1).standard_normal((2, 40))
    sampled = MODEL.sampled(RATE)
    state, states = np.zeros(6), []
    for now, following in zip(force.T[:-1], force.T[1:], strict=True):
        states.append(state)
        state = sampled.a @ state + sampled.b0 @ now + sampled.b1 @ following
    omega = 2 * np.pi * MODEL.frequency
    time = np.arange(40) / RATE

    def rate(t, x):
        push = MODEL.at_drives.T @ [np.interp(t, time, row) for row in force]
        return np.column_stack([x[1::2], push - 2 * MODEL.damping * omega * x[1::2] - omega**2 * x[::2]]).ravel()

    # Stopped at every sample, where the force has a corner.
    x = np.zeros(6)
    for index in range(39):
        np.testing.assert_allclose(states[index], x, rtol=1e-8, atol=1e-12)
        x = solve_ivp(rate, time[index : index + 2], x, rtol=1e-11, atol=1e-14).y[:, -1]


def test_the_sampled_frf_is_that_of_the_state_space():
    frequency = np.array([0.0, 0.7, 31.07, 31.3, 100.0, 256.0])
    sampled = MODEL.sampled(RATE)
    frf = MODEL.sampled_frf(frequency, RATE)
    for line, f in zip(frf, frequency, strict=True):
        z = np.exp(2j * np.pi * f / RATE)
        state = np.linalg.solve(z * np.eye(6) - sampled.a, sampled.b0 + sampled.b1 * z)
        np.testing.assert_allclose(line, sampled.c @ state + sampled.d, rtol=1e-9, atol=1e-12)


def test_far_below_the_sample_rate_it_is_the_frf_of_the_structure():
    frequency = np.linspace(0.5, 40.0, 200)
    fast = MODEL.sampled_frf(frequency, 100_000.0)
    np.testing.assert_allclose(fast, MODEL.continuous_frf(frequency), rtol=1e-5, atol=1e-6)


def test_a_single_mode_has_its_textbook_peak():
    one = ModalModel(np.array([10.0]), np.array([0.005]), np.array([[0.5]]), np.array([[0.5]]))
    # At resonance the acceleration is Φ² / (2 ζ).
    assert abs(one.continuous_frf(np.array([10.0]))[0, 0, 0]) == pytest.approx(0.25 / 0.01)
    poles = np.log(np.linalg.eigvals(one.sampled(RATE).a)) * RATE
    assert np.abs(poles) / (2 * np.pi) == pytest.approx([10.0, 10.0])
    assert -poles.real / np.abs(poles) == pytest.approx([0.005, 0.005])
