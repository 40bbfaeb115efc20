"""Whole models: compiled against plain numpy, and their invariants."""

import math
import subprocess
import sys
from threading import Event, Thread
from time import perf_counter

import numpy as np
import pytest

from rig_sim.compile import compile_model, select_positive, sin


def test_the_compiled_pendulum_equals_the_plain_one(double_pendulum):
    generator = np.random.default_rng(3)
    for _ in range(50):
        state, torque = generator.normal(size=4) * 2.0, generator.normal(size=2)
        derivative, outputs = double_pendulum.plain(state, torque)
        scale = np.abs(derivative).max()
        compiled = double_pendulum.compiled.derivative(state, torque)
        np.testing.assert_allclose(compiled, derivative, rtol=1e-14, atol=1e-14 * scale)
        np.testing.assert_allclose(
            double_pendulum.compiled.outputs(state, torque), outputs, rtol=1e-14, atol=1e-14 * np.abs(outputs).max()
        )


def test_the_energy_drift_of_the_free_pendulum_falls_with_the_fourth_order_or_faster(double_pendulum):
    commands = np.zeros((2, 2001))
    drift = []
    for substeps in (1, 2, 4):
        energy = double_pendulum.compiled.play(
            [1.2, -0.4, 0.0, 1.0], commands, sample_interval=2e-2, substeps=substeps
        ).outputs[0]
        drift.append(np.abs(energy - energy[0]).max())
    assert drift[0] < 1e-2
    assert drift[1] < drift[0] / 12
    assert drift[2] < drift[1] / 12


def test_results_that_are_inputs_or_constants_are_stored_and_may_repeat():
    model = compile_model(
        lambda state, inputs: ([inputs[1], 2.0], [state[0], state[0], 3, inputs[0], -state[1]]),
        state_names=["a", "b"],
        input_names=["u", "w"],
    )
    assert model.derivative([1.0, 2.0], [5.0, 6.0]).tolist() == [6.0, 2.0]
    assert model.outputs([1.0, 2.0], [5.0, 6.0]).tolist() == [1.0, 1.0, 3.0, 5.0, -2.0]
    assert model.output_names == ("output_0", "output_1", "output_2", "output_3", "output_4")


def test_a_state_and_an_input_may_share_a_name():
    model = compile_model(lambda s, u: ([u[0] - s[0]], []), state_names=["height"], input_names=["height"])
    assert model.derivative([1.0], [4.0]).tolist() == [3.0]


def test_a_model_without_inputs_and_outputs_plays():
    model = compile_model(lambda s, u: ([-s[0]], []), state_names=["x"], input_names=[])
    playback = model.play([1.0], np.empty((0, 101)), sample_interval=0.01, substeps=1)
    assert playback.outputs.shape == (0, 100)
    assert playback.state[0] == pytest.approx(math.exp(-1.0), rel=1e-9)


def test_two_models_live_side_by_side():
    models = [compile_model(lambda s, u, k=k: ([k * s[0]], []), state_names=["x"], input_names=[]) for k in range(3)]
    assert [model.derivative([2.0], [])[0] for model in models] == [0.0, 2.0, 4.0]


def test_operations_are_counted_without_dead_code():
    def model(state, inputs):
        _ = sin(state[0]) * 5.0
        return [state[0] * state[0] + 1.0], [state[0] * 3.0]

    assert compile_model(model, state_names=["x"], input_names=[]).operation_count == 2


def test_another_python_thread_runs_while_a_model_plays(double_pendulum):
    commands = np.zeros((2, 1001))
    ticks, stop = [], Event()

    def tick():
        while not stop.wait(0.001):
            ticks.append(perf_counter())

    thread = Thread(target=tick)
    thread.start()
    begin = perf_counter()
    double_pendulum.compiled.play([0.1, 0.0, 0.0, 0.0], commands, sample_interval=1e-3, substeps=1000)
    end = perf_counter()
    stop.set()
    thread.join()
    assert sum(begin + 0.005 < time < end - 0.005 for time in ticks) >= 1


@pytest.mark.parametrize(
    ("function", "names", "message"),
    [
        (lambda s, u: ([s[0]], []), {"state_names": ["x", "y"]}, "1 derivatives for 2 states"),
        (lambda s, u: ([], []), {"state_names": []}, "0 derivatives for 0 states"),
        (lambda s, u: ([s[0], s[0]], []), {"state_names": ["x", "x"]}, "state name 'x' is given twice"),
        (lambda s, u: ([s[0]], [s[0]]), {"state_names": ["x"], "output_names": []}, "1 outputs for 0 names"),
        (lambda s, u: ([select_positive(math.inf, s[0], 1)], []), {"state_names": ["x"]}, "inf .* not finite"),
    ],
)
def test_a_model_that_does_not_fit_its_names_is_refused(function, names, message):
    with pytest.raises(ValueError, match=message):
        compile_model(function, input_names=[], **names)


def test_a_vector_of_the_wrong_length_is_refused(double_pendulum):
    with pytest.raises(ValueError, match=r"state has the shape \(3,\); give \(4,\)"):
        double_pendulum.compiled.derivative([0.0] * 3, [0.0] * 2)
    with pytest.raises(ValueError, match=r"inputs has the shape \(1,\); give \(2,\)"):
        double_pendulum.compiled.outputs([0.0] * 4, [0.0])


def test_code_in_a_reference_cycle_is_freed_in_order():
    # The collector finalises a cycle in any order; freeing LLVM's context before its engine would end the process.
    script = """
import gc
from rig_sim.compile import compile_model

for _ in range(40):
    model = compile_model(lambda s, u: ([-s[0]], [s[0]]), state_names=["x"], input_names=[])
    ring = [model]
    ring.append(ring)
    assert model.derivative([1.0], [])[0] == -1.0
    del model, ring
    gc.collect()
"""
    finished = subprocess.run([sys.executable, "-c", script], timeout=120, check=False)
    assert finished.returncode == 0
