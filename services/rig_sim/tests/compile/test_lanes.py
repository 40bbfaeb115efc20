"""Two sides of a model in the lanes of a vector: mirrors found, and refused for a reason."""

import math

import numpy as np
import pytest
from two_sided_models import CHAIN_STATES, INPUTS, OPERATIONS, STATES, chain, looking_across, two_sides

from rig_sim.compile import compile_model, exp, sin, sqrt, trace_model
from rig_sim.compile.constants import LaneTable
from rig_sim.compile.lanes import mirrored_model


def compiled(model, states=STATES, inputs=INPUTS, **options):
    return compile_model(model, state_names=states, input_names=inputs, **options)


def test_without_fusing_lanes_give_the_bits_of_the_scalar_code():
    model = two_sides(lambda x, y, c: (x - c * y) * sin(c * x) / (y - 4.0), (0.7, -0.7))
    lanes, scalar = (compiled(model, contract=False, lanes=wanted) for wanted in (True, False))
    rng = np.random.default_rng(5)
    for _ in range(50):
        state, inputs = rng.normal(size=4), rng.normal(size=2)
        np.testing.assert_array_equal(lanes.derivative(state, inputs), scalar.derivative(state, inputs))


@pytest.mark.parametrize("signs", [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, -1.0, -1.0), (-1.0, 1.0, -1.0)])
def test_a_sum_of_sums_is_one_chain_in_which_products_cost_nothing_but_their_sum(signs):
    a, b, c = signs

    def side(x, y, k):
        return (a * (x * (y + k)) + b * (y * (x + k))) - (c * (x * (x - k)) - k * (x + y + k))

    def model(state, inputs):
        return [side(state[0], state[1], 0.7), inputs[0], side(state[2], state[3], 0.9), inputs[1]], []

    traced = trace_model(model, state_names=STATES, input_names=INPUTS)
    mirrored = mirrored_model(traced)
    assert mirrored is not None
    text = mirrored.text(contract=True, table=LaneTable((), rigs=2), rigs=2)
    # Of the four products one is where the chain begins; the others are fused with their sums.
    assert (text.count(" fmul <4 x double>"), text.count("call <4 x double> @llvm.fma")) == (1, 3)
    lanes = compiled(model)
    rng = np.random.default_rng(8)
    for _ in range(30):
        state, inputs = rng.normal(size=4), rng.normal(size=2)
        expected = np.array(model(state, inputs)[0], dtype=float)
        np.testing.assert_allclose(lanes.derivative(state, inputs), expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("edge", [0.0, -0.0, math.nan, math.inf, 1e300])
def test_a_value_beyond_numbers_stays_on_its_side(edge):
    lanes = compiled(two_sides(OPERATIONS["clamp"], (0.7, -0.7)))
    quiet = lanes.derivative([0.5, 0.25, 0.5, 0.25], [0.0, 0.0])
    np.testing.assert_array_equal(lanes.derivative([0.5, 0.25, edge, 1.0], [0.0, 0.0])[:2], quiet[:2])
    np.testing.assert_array_equal(lanes.derivative([edge, 1.0, 0.5, 0.25], [0.0, 0.0])[2:], quiet[2:])


def test_what_looks_across_takes_the_other_lane_with_its_sign():
    lanes = compiled(looking_across)
    assert lanes.lanes == 2
    rng = np.random.default_rng(7)
    for _ in range(30):
        state, inputs = rng.normal(size=4), rng.normal(size=2)
        rates, outputs = looking_across(state, inputs)
        np.testing.assert_allclose(lanes.derivative(state, inputs), np.array(rates, dtype=float), rtol=1e-12)
        np.testing.assert_allclose(lanes.outputs(state, inputs), np.array(outputs, dtype=float), rtol=1e-12)


@pytest.mark.parametrize("coupling", [0.0, 1.0])
def test_sides_with_a_rack_between_them_play_in_lanes_as_the_scalar_code_does(coupling):
    def model(state, inputs):
        return chain(state, inputs, coupling=coupling)

    lanes, scalar = (compiled(model, CHAIN_STATES, INPUTS, lanes=wanted) for wanted in (True, False))
    assert lanes.lanes == 2
    time = np.arange(2001) / 1000.0
    commands = np.array([np.sin(9.0 * time), 0.5 * np.cos(7.0 * time)])
    rest = np.linspace(-0.2, 0.3, 10)
    ours, theirs = (m.play(rest, commands, sample_interval=1e-3, substeps=2) for m in (lanes, scalar))
    assert np.abs(ours.outputs).max() > 0.1
    np.testing.assert_allclose(ours.outputs, theirs.outputs, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ours.state, theirs.state, rtol=1e-11, atol=1e-12)


def test_chunks_in_lanes_give_the_bits_of_one_call():
    lanes = compiled(lambda state, inputs: chain(state, inputs, coupling=1.0), CHAIN_STATES, INPUTS)
    commands = np.random.default_rng(6).normal(size=(2, 301))
    whole = lanes.play(np.zeros(10), commands, sample_interval=1e-3, substeps=2)
    state, pieces = np.zeros(10), []
    for begin, end in ((0, 1), (1, 120), (120, 300)):
        piece = lanes.play(state, commands[:, begin : end + 1], sample_interval=1e-3, substeps=2)
        state = piece.state
        pieces.append(piece.outputs)
    assert np.hstack(pieces).tobytes() == whole.outputs.tobytes()
    assert state.tobytes() == whole.state.tobytes()


def test_bounds_and_names_of_what_diverged_keep_the_models_order():
    model = two_sides(OPERATIONS["add"], (0.7, -0.7))
    bounds = [1e9, 1e9, 1e9, 1e-3]
    played = compiled(model).play([0, 0, 0, 0], np.ones((2, 100)), sample_interval=1e-3, substeps=1, bounds=bounds)
    assert played.diverged_states == ("right y",)


def test_unlike_sides_stay_scalar():
    def model(state, inputs):
        a, b, c, d = state
        return [
            a * b * b - inputs[0],
            sin(a) / (b + 5.0),
            exp(-d) - c / (2.0 + inputs[1] * d),
            sqrt(1.0 + c * d) + c,
        ], []

    assert compiled(model).lanes == 1


def test_a_single_chain_stays_scalar():
    def model(state, inputs):
        rates = [state[1] * inputs[0]]
        for k in range(1, 6):
            rates.append(sin(state[k - 1]) * (k + 1.0) - state[k] / (1.0 + rates[-1] * rates[-1]))
        return rates, []

    assert compiled(model, [f"x{k}" for k in range(6)], ["u"]).lanes == 1


def test_the_order_in_which_states_are_listed_does_not_matter():
    model = two_sides(OPERATIONS["atan2"], (0.7, -0.7))
    order = np.array([3, 0, 2, 1])

    def shuffled(state, inputs):
        listed = np.empty(4, dtype=object)
        listed[order] = state
        rates, outputs = model(listed, inputs)
        return [rates[k] for k in order], outputs

    lanes = compiled(shuffled, [STATES[k] for k in order])
    assert lanes.lanes == 2
    state = np.array([0.3, -0.4, 0.5, 0.6])
    expected = np.array(model(state, [0.1, 0.2])[0], dtype=float)
    np.testing.assert_allclose(lanes.derivative(state[order], [0.1, 0.2]), expected[order], rtol=1e-13)


@pytest.mark.parametrize("rates", [(1.0, 1.0), (1.0, -1.0), (0.0, 0.0)])
def test_rates_that_are_constants_leave_only_outputs_to_the_lanes(rates):
    """Each output takes the other side's state: lanes are exchanged of a vector that nothing else has loaded."""

    def model(state, inputs):
        return list(rates), [state[1] * inputs[0] + 2.0, state[0] * inputs[1] + 2.0]

    lanes = compiled(model, ["left", "right"], ["u", "w"])
    np.testing.assert_array_equal(lanes.derivative([0.3, 0.7], [0.2, 0.9]), rates)
    np.testing.assert_allclose(lanes.outputs([0.3, 0.7], [0.2, 0.9]), [2.14, 2.27], rtol=1e-15)
