"""The player: its order, its command between samples, its chunks, its clear end when a model diverges."""

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from graph_interpreter import interpret
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from rig_sim.compile import Method, compile_model, trace_model
from rig_sim.compile.integrate import amplification

INTERVAL = 1e-3


def command(samples, *, seed=0):
    time = np.arange(samples + 1) * INTERVAL
    generator = np.random.default_rng(seed)
    return (np.sin(2 * np.pi * 7.0 * time) * 300.0 + generator.normal(size=samples + 1) * 50.0)[np.newaxis]


@pytest.mark.parametrize("method", Method)
def test_the_error_falls_with_the_methods_order(double_pendulum, method):
    """On a nonlinear motion: what holds for a linear one alone would show."""
    state, torque = np.array([0.4, -0.7, 1.0, 0.5]), np.array([[0.3, 0.9], [-0.2, 0.4]])
    span = 2.0
    reference = solve_ivp(
        lambda t, y: double_pendulum.compiled.derivative(y, torque[:, 0] + (torque[:, 1] - torque[:, 0]) * t / span),
        (0.0, span),
        state,
        method="DOP853",
        rtol=1e-13,
        atol=1e-15,
    ).y[:, -1]
    play = double_pendulum.compiled.play
    errors = [
        np.abs(play(state, torque, sample_interval=span, substeps=n, method=method).state - reference).max()
        for n in (64, 128, 256)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), method.tableau.order, atol=0.5)


@pytest.mark.parametrize("method", Method)
def test_a_step_multiplies_a_linear_motion_as_the_exponential_does_up_to_the_order(method):
    tableau = method.tableau
    assert all(sum(row) == node for row, node in zip(tableau.stages, tableau.nodes[1:], strict=True))
    growth = tableau.growth()
    for power in range(tableau.order + 1):
        assert float(growth[power] * math.factorial(power)) == pytest.approx(1.0, abs=1e-11)
    model = compile_model(lambda s, u: ([-s[0]], []), state_names=["x"], input_names=[])
    played = model.play([1.0], np.empty((0, 2)), sample_interval=1.5, substeps=1, method=method)
    assert abs(played.state[0]) == pytest.approx(amplification(np.array(-1.5), method), rel=1e-13)


def test_the_error_falls_with_the_fourth_power_of_the_step(linear_oscillator):
    samples = 100
    commands = command(samples)
    reference = np.array([0.01, 0.0])
    for k in range(samples):  # sample by sample, since the command has a kink at each
        reference = solve_ivp(
            lambda t, y, k=k: (
                linear_oscillator.matrix @ y + [0.0, commands[0, k] + (commands[0, k + 1] - commands[0, k]) * t / 0.01]
            ),
            (0.0, 0.01),
            reference,
            method="DOP853",
            rtol=1e-13,
            atol=1e-15,
        ).y[:, -1]
    errors = []
    for substeps in (1, 2, 4, 8):
        final = linear_oscillator.compiled.play([0.01, 0.0], commands, sample_interval=0.01, substeps=substeps).state
        errors.append(np.abs(final[1] - reference[1]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.25)


def test_the_response_to_a_command_of_straight_lines_is_the_exact_one(linear_oscillator):
    samples = 200
    commands = command(samples)
    # The oscillator, its command and the command's rise: what a first-order hold is in closed form.
    augmented = np.zeros((4, 4))
    augmented[:2, :2] = linear_oscillator.matrix
    augmented[1, 2] = augmented[2, 3] = 1.0
    transition = expm(augmented * INTERVAL)
    expected = np.zeros((2, samples + 1))
    for k in range(samples):
        rise = (commands[0, k + 1] - commands[0, k]) / INTERVAL
        expected[:, k + 1] = (transition @ [*expected[:, k], commands[0, k], rise])[:2]
    playback = linear_oscillator.compiled.play([0.0, 0.0], commands, sample_interval=INTERVAL, substeps=4)
    np.testing.assert_allclose(playback.outputs[0], expected[0, :-1], rtol=0, atol=1e-9 * np.abs(expected[0]).max())
    np.testing.assert_allclose(playback.state, expected[:, -1], rtol=1e-8)


def test_a_linear_command_is_integrated_exactly():
    model = compile_model(lambda s, u: ([u[0]], [u[0]]), state_names=["x"], input_names=["u"])
    commands = command(50)
    playback = model.play([0.0], commands, sample_interval=INTERVAL, substeps=3)
    assert playback.state[0] == pytest.approx(np.trapezoid(commands[0], dx=INTERVAL), rel=1e-12)
    np.testing.assert_array_equal(playback.outputs, commands[:, :-1])


def test_outputs_are_those_of_the_sample_instant(double_pendulum):
    torque = np.random.default_rng(2).normal(size=(2, 21))
    state = np.array([0.3, 0.2, 0.0, -1.0])
    whole = double_pendulum.compiled.play(state, torque, sample_interval=0.01, substeps=2)
    for k in range(20):
        expected = double_pendulum.compiled.outputs(state, torque[:, k])
        np.testing.assert_array_equal(whole.outputs[:, k], expected)
        state = double_pendulum.compiled.play(state, torque[:, k : k + 2], sample_interval=0.01, substeps=2).state
    np.testing.assert_array_equal(whole.state, state)


def test_a_step_is_that_of_the_textbook(double_pendulum):
    """Runge and Kutta's own formula in numpy, on the interpreted graph."""
    traced = trace_model(
        double_pendulum.plain, state_names=["q1", "q2", "v1", "v2"], input_names=["torque1", "torque2"]
    )
    names = [node.name for node in (*traced.state, *traced.inputs)]

    def slope(state, inputs):
        return np.array(interpret(traced.derivative, dict(zip(names, [*state, *inputs], strict=True))))

    h, state = 0.005, np.array([0.3, 0.2, 0.0, -1.0])
    commands = np.array([[1.0, 3.0], [-2.0, 0.5]])
    expected = state
    for j in range(2):
        u0, um, u1 = (commands[:, 0] + np.diff(commands)[:, 0] * (j + part) / 2 for part in (0.0, 0.5, 1.0))
        k1 = slope(expected, u0)
        k2 = slope(expected + h / 2 * k1, um)
        k3 = slope(expected + h / 2 * k2, um)
        k4 = slope(expected + h * k3, u1)
        expected = expected + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    final = double_pendulum.compiled.play(state, commands, sample_interval=0.01, substeps=2).state
    np.testing.assert_allclose(final, expected, rtol=1e-14)


@pytest.mark.parametrize("chunk", [1, 7, 64, 300])
def test_chunks_give_the_bits_of_one_call(double_pendulum, chunk):
    samples = 300
    torque = np.random.default_rng(5).normal(size=(2, samples + 1))
    options = {"sample_interval": INTERVAL, "substeps": 3}
    whole = double_pendulum.compiled.play([0.3, 0.2, 0.0, -1.0], torque, **options)
    state, parts = np.array([0.3, 0.2, 0.0, -1.0]), []
    for begin in range(0, samples, chunk):
        part = double_pendulum.compiled.play(state, torque[:, begin : min(begin + chunk, samples) + 1], **options)
        parts.append(part.outputs)
        state = part.state
    assert np.concatenate(parts, axis=1).tobytes() == whole.outputs.tobytes()
    assert state.tobytes() == whole.state.tobytes()


@pytest.fixture(scope="module")
def exploding():
    return compile_model(
        lambda s, u: ([-s[0], s[1] * s[1]], [s[1]]), state_names=["calm", "wild"], input_names=["nothing"]
    )


def test_a_state_that_leaves_its_bound_stops_the_player_at_that_sample(exploding):
    commands = np.zeros((1, 101))
    playback = exploding.play([1.0, 1.0], commands, sample_interval=0.05, substeps=4, bounds=[10.0, 2.0])
    solution = 1.0 / (1.0 - 0.05 * np.arange(20))  # exact: 2.0 is reached at 0.5 s, sample 10
    assert playback.diverged_at == 11
    assert playback.diverged_states == ("wild",)
    assert playback.outputs.shape == (1, 11)
    np.testing.assert_allclose(playback.outputs[0], solution[:11], rtol=1e-4)
    assert playback.state[1] == pytest.approx(solution[11], rel=1e-4)
    assert np.isfinite(playback.outputs).all()


def test_a_state_that_becomes_infinite_stops_the_player_without_bounds(exploding):
    playback = exploding.play([1.0, 1.0], np.zeros((1, 101)), sample_interval=0.05, substeps=4)
    assert playback.diverged_at is not None
    assert 20 <= playback.diverged_at <= 24
    assert playback.diverged_states == ("wild",)
    assert np.isfinite(playback.outputs).all()


def test_a_divergence_in_the_last_interval_is_reported(exploding):
    playback = exploding.play([1.0, 1.9], np.zeros((1, 2)), sample_interval=0.05, substeps=4, bounds=[10.0, 2.0])
    assert (playback.diverged_at, playback.outputs.shape) == (1, (1, 1))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_start_that_is_not_finite_is_reported_at_sample_0(exploding, value):
    playback = exploding.play([value, 0.0], np.zeros((1, 5)), sample_interval=0.05, substeps=1)
    assert (playback.diverged_at, playback.diverged_states) == (0, ("calm",))


def test_the_state_and_the_commands_given_are_not_changed(exploding):
    state, commands = np.array([1.0, 0.5]), np.zeros((1, 11))
    exploding.play(state, commands, sample_interval=0.05, substeps=1)
    assert state.tolist() == [1.0, 0.5]
    assert not commands.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"commands": np.zeros((2, 5))}, r"shape \(2, 5\); give \(1, samples \+ 1\)"),
        ({"commands": np.zeros(5)}, r"shape \(5,\)"),
        ({"commands": np.zeros((1, 0))}, r"shape \(1, 0\)"),
        ({"commands": np.array([[0.0, np.nan]])}, "'nothing' is nan at sample 1"),
        ({"sample_interval": 0.0}, "sample interval is 0.0 s"),
        ({"sample_interval": np.nan}, "sample interval is nan s"),
        ({"substeps": 0}, "substeps is 0"),
        ({"substeps": 1.5}, "substeps is 1.5"),
        ({"bounds": [1.0]}, r"bounds has the shape \(1,\)"),
        ({"bounds": [1.0, np.nan]}, "bound of the state 'wild' is nan"),
    ],
)
def test_what_cannot_be_played_is_refused(exploding, change, message):
    given = {"state": [0.0, 0.0], "commands": np.zeros((1, 5)), "sample_interval": 0.01, "substeps": 1} | change
    with pytest.raises(ValueError, match=message):
        exploding.play(given.pop("state"), given.pop("commands"), **given)


DIGEST = """
import hashlib, sys
sys.path.insert(0, {folder!r})
from conftest import pendulum
from rig_sim.compile import compile_model
import numpy as np
model = compile_model(pendulum, state_names=["q1", "q2", "v1", "v2"], input_names=["torque1", "torque2"])
torque = np.random.default_rng(9).normal(size=(2, 501))
playback = model.play([0.3, 0.2, 0.0, -1.0], torque, sample_interval=1e-3, substeps=2)
sys.stdout.write(hashlib.sha256(playback.outputs.tobytes() + playback.state.tobytes()).hexdigest())
"""


def test_two_processes_give_the_same_bits(double_pendulum):
    script = DIGEST.format(folder=str(Path(__file__).parent))
    digests = {
        subprocess.run(
            [sys.executable, "-c", script],
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    torque = np.random.default_rng(9).normal(size=(2, 501))
    playback = double_pendulum.compiled.play([0.3, 0.2, 0.0, -1.0], torque, sample_interval=1e-3, substeps=2)
    assert digests == {hashlib.sha256(playback.outputs.tobytes() + playback.state.tobytes()).hexdigest()}
