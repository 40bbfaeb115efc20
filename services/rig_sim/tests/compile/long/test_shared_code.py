"""Code that models of one structure share: the bytes of each are those that it has alone."""

import numpy as np
import pytest

import rig_sim.compile.model as compile_model_module
from rig_sim.compile import FOLDER_VARIABLE, absolute, atan2, compile_model, maximum, select_positive, sin, tanh

NUMBERS = (0.3, -0.3, 0.3 + 1e-12, 0.5, 1.0, -1.0, 2.0, 7.1, -7.1, 7.2, 0.0, 1.0 / 6.0, 1e-3)
"""Constants that are alike, opposite, alike to ten digits, or what functions are written out with."""


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """Return how often a compiler was asked."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "code"))
    asked = []
    original = compile_model_module.compile_module

    def counted(text, **options):
        asked.append(text)
        return original(text, **options)

    monkeypatch.setattr(compile_model_module, "compile_module", counted)
    return asked


def two_pendulums(left, right, coupling, *, lanes=True, shared=True):
    """Two sides with the same equations, whose constants may differ."""

    def side(angle, rate, other, torque, numbers):
        stiffness, friction, stop = numbers
        force = stiffness * sin(angle) + friction * tanh(4.7 * rate) + coupling * (angle - other)
        force = force + select_positive(angle - stop, 3.3 * (angle - stop), 0.0) + maximum(rate, stop)
        return torque - force + 0.1 * atan2(angle, absolute(stiffness) + 2.5)

    def model(s, u):
        first, second = side(s[0], s[1], s[2], u[0], left), side(s[2], s[3], s[0], u[1], right)
        return [s[1], first, s[3], second], [s[0] + 0.37 * s[2], first * left[0] - right[1]]

    names = ["left.angle", "left.rate", "right.angle", "right.rate"]
    return compile_model(model, state_names=names, input_names=["left", "right"], lanes=lanes, shared=shared)


def played(model):
    commands = np.random.default_rng(7).standard_normal((2, 101))
    result = model.play([0.3, 0.0, -0.2, 0.1], commands, sample_interval=0.01, substeps=2)
    return result.outputs.tobytes() + result.state.tobytes()


@pytest.mark.parametrize("lanes", [True, False])
def test_models_that_differ_in_their_numbers_are_compiled_once(compiled, lanes):
    for stiffness in (9.81, 9.9, 11.3):
        side = (stiffness, 0.21, 0.87)
        kept = played(two_pendulums(side, side, 0.43, lanes=lanes))
        assert len(compiled) == 1
        alone = two_pendulums(side, side, 0.43, lanes=lanes, shared=False)
        compiled.pop()
        assert kept == played(alone)


def test_whatever_the_numbers_are_the_bytes_are_those_of_the_model_alone(compiled):
    draws = np.random.default_rng(5)
    for _ in range(60):
        numbers = draws.choice(NUMBERS, size=7)
        sides = tuple(map(float, numbers[:3])), tuple(map(float, numbers[3:6]))
        if draws.random() < 0.5:
            sides = (sides[0], sides[0])
        coupling = float(numbers[6])
        assert played(two_pendulums(*sides, coupling)) == played(two_pendulums(*sides, coupling, shared=False))


def test_sides_that_differ_by_a_tolerance_share_their_code_with_one_another(compiled):
    for tolerance in (0.9, 0.95, 1.07):
        left, right = (9.81 * tolerance, 0.21, 0.87), (9.81, 0.21, 0.87)
        kept = played(two_pendulums(left, right, 0.43))
        assert len(compiled) == 1
        assert kept == played(two_pendulums(left, right, 0.43, shared=False))
        compiled.pop()


def test_equal_numbers_are_another_structure_than_different_ones(compiled):
    two_pendulums((9.81, 0.21, 0.87), (9.81, 0.21, 0.87), 0.43)
    two_pendulums((9.81, 0.21, 0.87), (9.81, 0.22, 0.87), 0.43)
    two_pendulums((9.81, 0.21, 0.87), (9.81, 0.21, 0.87), 0.5)
    assert len(compiled) == 3
