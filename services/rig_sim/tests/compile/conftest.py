"""Models with known properties, written once for traced and plain scalars."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rig_sim.compile import compile_model, cos, sin

sys.path.insert(0, str(Path(__file__).parent))

GRAVITY = 9.81
MASSES = (1.3, 0.7)
LENGTHS = (0.9, 1.4)


def pendulum_energy(state):
    """Return the energy of the double pendulum [J]."""
    q1, q2, v1, v2 = state
    (m1, m2), (l1, l2) = MASSES, LENGTHS
    kinetic = 0.5 * (m1 + m2) * (l1 * v1) ** 2 + 0.5 * m2 * (l2 * v2) ** 2 + m2 * l1 * l2 * v1 * v2 * cos(q1 - q2)
    return kinetic - (m1 + m2) * GRAVITY * l1 * cos(q1) - m2 * GRAVITY * l2 * cos(q2)


def pendulum(state, inputs):
    """Double pendulum of point masses, angles from the vertical [rad], driven by torques on both arms [N·m]."""
    q, v = state[:2], state[2:]
    (m1, m2), (l1, l2) = MASSES, LENGTHS
    c, s = cos(q[0] - q[1]), sin(q[0] - q[1])
    mass = np.array([[(m1 + m2) * l1**2, m2 * l1 * l2 * c], [m2 * l1 * l2 * c, m2 * l2**2]])
    coriolis = np.array([[0.0, m2 * l1 * l2 * s * v[1]], [-m2 * l1 * l2 * s * v[0], 0.0]])
    gravity = np.array([(m1 + m2) * GRAVITY * l1 * sin(q[0]), m2 * GRAVITY * l2 * sin(q[1])])
    force = np.asarray(inputs) - coriolis @ v - gravity
    determinant = mass[0, 0] * mass[1, 1] - mass[0, 1] * mass[1, 0]
    acceleration = np.array([[mass[1, 1], -mass[0, 1]], [-mass[1, 0], mass[0, 0]]]) @ force / determinant
    return [*v, *acceleration], [pendulum_energy(state), *acceleration]


OSCILLATOR_FREQUENCY = 2.0 * np.pi * 5.0
OSCILLATOR_DAMPING = 0.1


def oscillator(state, inputs):
    """Linear oscillator with a force input."""
    x, v = state
    return [v, inputs[0] - OSCILLATOR_FREQUENCY**2 * x - 2 * OSCILLATOR_DAMPING * OSCILLATOR_FREQUENCY * v], [x, x + v]


@pytest.fixture(scope="session")
def double_pendulum():
    compiled = compile_model(
        pendulum,
        state_names=["q1", "q2", "v1", "v2"],
        input_names=["torque1", "torque2"],
        output_names=["energy", "a1", "a2"],
    )
    return SimpleNamespace(plain=pendulum, energy=pendulum_energy, compiled=compiled)


@pytest.fixture(scope="session")
def linear_oscillator():
    matrix = np.array([[0.0, 1.0], [-(OSCILLATOR_FREQUENCY**2), -2 * OSCILLATOR_DAMPING * OSCILLATOR_FREQUENCY]])
    compiled = compile_model(oscillator, state_names=["x", "v"], input_names=["force"])
    return SimpleNamespace(matrix=matrix, compiled=compiled)
