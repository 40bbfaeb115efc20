"""Every operation: compiled against numpy and against plain floats, over random and edge values."""

import math

import numpy as np
import pytest
from graph_interpreter import interpret

from rig_sim.compile import (
    absolute,
    asin,
    atan2,
    clamp,
    compile_model,
    cos,
    exp,
    inverse_sqrt,
    maximum,
    minimum,
    select_positive,
    sin,
    sqrt,
    tanh,
    trace_model,
)

EDGES = np.array([0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1e-300, -1e-300, 5e-324, 1e-8, -1e-8, 1e8, -1e8, 1e15, 1e150])
ANGLES = np.concatenate(
    [np.arange(-16, 17) * math.pi / 8, [0.0, -0.0, 1e-9, -1e-9, 1e3, -1e3, 1e6 + 0.3, -1e6, 1e10, 1e15]]
)
RANDOM = np.random.default_rng(1).normal(size=60) * 3.0
REALS = np.concatenate([EDGES, RANDOM])
PAIRS = np.array(
    [(a, b) for a in EDGES for b in EDGES] + list(zip(RANDOM, RANDOM[::-1], strict=True)) + [(a, a) for a in RANDOM]
).T
ONE_ULP = 2.3e-16

UNARY = [
    (lambda x: -x, np.negative, REALS, 0.0),
    (abs, np.abs, REALS, 0.0),
    (absolute, np.abs, REALS, 0.0),
    (sqrt, np.sqrt, np.abs(REALS), 0.0),
    (inverse_sqrt, lambda x: 1.0 / np.sqrt(x), np.abs(REALS[REALS != 0.0]), 0.0),
    (sin, np.sin, np.concatenate([ANGLES, RANDOM]), 4 * ONE_ULP),
    (cos, np.cos, np.concatenate([ANGLES, RANDOM]), 4 * ONE_ULP),
    (tanh, np.tanh, REALS, 4 * ONE_ULP),
    (exp, np.exp, np.concatenate([RANDOM, [0.0, -0.0, 709.0, -745.0, -1e4, 1e-300]]), 4 * ONE_ULP),
    (asin, np.arcsin, np.concatenate([np.linspace(-1.0, 1.0, 41), [-0.0, 1e-300, 1 - 1e-16]]), 4 * ONE_ULP),
    (lambda x: x**3, lambda x: x * (x * x), RANDOM, 2 * ONE_ULP),
    (lambda x: x**-1, np.reciprocal, RANDOM, 0.0),
    (lambda x: clamp(x, -0.5, 2.0), lambda x: np.clip(x, -0.5, 2.0), REALS, 0.0),
]
BINARY = [
    (lambda a, b: a + b, np.add, PAIRS, 0.0),
    (lambda a, b: a - b, np.subtract, PAIRS, 0.0),
    (lambda a, b: a * b, np.multiply, PAIRS[:, np.abs(PAIRS).max(axis=0) < 1e150], 0.0),
    (lambda a, b: a / b, np.divide, PAIRS[:, (np.abs(PAIRS[1]) > 1e-9) & (PAIRS[1] != 0.0)], 0.0),
    (minimum, np.minimum, PAIRS, 0.0),
    (maximum, np.maximum, PAIRS, 0.0),
    (atan2, np.arctan2, PAIRS[:, (PAIRS[0] != 0.0) | ~np.signbit(PAIRS).any(axis=0)], 4 * ONE_ULP),
    (lambda a, b: select_positive(a, b, 7.0), lambda a, b: np.where(a >= 0.0, b, 7.0), PAIRS, 0.0),
    (lambda a, b: select_positive(a - b, a, -a), lambda a, b: np.where(a >= b, a, -a), PAIRS, 0.0),
]


def compiled_values(operation, arguments):
    model = compile_model(
        lambda state, inputs: ([operation(*state)] * len(state), []),
        state_names=[f"x{i}" for i in range(len(arguments))],
        input_names=[],
    )
    return np.array([model.derivative(point, [])[0] for point in arguments.T])


@pytest.mark.parametrize(("operation", "oracle", "values", "tolerance"), UNARY)
def test_a_unary_operation_gives_what_numpy_gives(operation, oracle, values, tolerance):
    compiled = compiled_values(operation, values[np.newaxis])
    np.testing.assert_allclose(compiled, oracle(values), rtol=tolerance, atol=5e-324)
    nonzero = values != 0.0  # a zero's sign is not kept
    np.testing.assert_array_equal(np.signbit(compiled)[nonzero], np.signbit(oracle(values))[nonzero])
    plain = np.array([operation(float(value)) for value in values])
    np.testing.assert_allclose(plain, oracle(values), rtol=tolerance, atol=5e-324)


@pytest.mark.parametrize(("operation", "oracle", "values", "tolerance"), BINARY)
def test_a_binary_operation_gives_what_numpy_gives(operation, oracle, values, tolerance):
    with np.errstate(under="ignore"):
        expected = oracle(*values)
    np.testing.assert_allclose(compiled_values(operation, values), expected, rtol=tolerance, atol=5e-324)
    plain = np.array([operation(float(a), float(b)) for a, b in values.T])
    np.testing.assert_allclose(plain, expected, rtol=tolerance, atol=5e-324)


@pytest.mark.parametrize(
    "operation", [sqrt, inverse_sqrt, minimum, maximum, clamp, abs, sin, cos, tanh, exp, asin, atan2]
)
def test_nan_is_never_hidden(operation):
    arity = {minimum: 2, maximum: 2, atan2: 2, clamp: 3}.get(operation, 1)
    for place in range(arity):
        arguments = np.ones((arity, 1))
        arguments[place] = math.nan
        assert np.isnan(compiled_values(operation, arguments)).all()
        assert math.isnan(operation(*arguments[:, 0].tolist()))


@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.parametrize(
    "bounded",
    [lambda x: minimum(x, 1.0), lambda x: maximum(-1.0, x), lambda x: clamp(x, -1.0, 1.0)],
    ids=["minimum", "maximum", "both"],
)
def test_a_bound_never_hides_nan(bounded, lanes):
    # One side alone, or two as a vector; beside the bound something that is worth a vector.
    def side(x):
        return [bounded(x), sum(math.sqrt(k) * sin(k * x) for k in range(1, 4))]

    model = compile_model(
        lambda state, inputs: ([rate for x in state[::2] for rate in side(x)], []),
        state_names=[f"x{i}" for i in range(2 * lanes)],
        input_names=[],
    )
    assert model.lanes == lanes
    assert np.isnan(model.derivative(np.full(2 * lanes, math.nan), [])[::2]).all()
    values = np.linspace(-2.0, 2.0, 9)
    found = [model.derivative(np.full(2 * lanes, value), [])[-2] for value in values]
    np.testing.assert_array_equal(found, [bounded(float(value)) for value in values])


def test_a_selection_takes_the_negative_side_for_nan():
    assert compiled_values(lambda x: select_positive(x, 1.0, 2.0), np.array([[math.nan]]))[0] == 2.0
    assert select_positive(math.nan, 1.0, 2.0) == 2.0


RANDOM_OPERATIONS = [
    lambda a, b, c: a * 0.5 + b,
    lambda a, b, c: a - b * 0.25,
    lambda a, b, c: a * b / (1.0 + b * b),
    lambda a, b, c: -a,
    lambda a, b, c: select_positive(a, b, -c),
    lambda a, b, c: minimum(a, b) + maximum(b, c) * 0.5,
    lambda a, b, c: sqrt(1.0 + a * a),
    lambda a, b, c: abs(a) - c,
    lambda a, b, c: a * 3.0 - 3.0 * b,
]


def random_program(seed, *, steps=400):
    """Return a model of random operations that stays finite: the same program on every call."""

    def program(state, inputs):
        generator = np.random.default_rng(seed)
        values = [*state, *inputs, 0.0, 1.0, -2.0]
        for _ in range(steps):
            operands = (values[i] for i in generator.integers(len(values), size=3))
            new = RANDOM_OPERATIONS[generator.integers(len(RANDOM_OPERATIONS))](*operands)
            values.append(new / sqrt(1.0 + new * new) if generator.random() < 0.3 else new * 0.5)
        return values[-len(state) :], values[-30:]

    return program


@pytest.mark.parametrize("seed", range(8))
def test_without_fused_operations_compiled_code_gives_the_values_of_python_floats(seed):
    program = random_program(seed)
    names = list("abcdef")
    exact = compile_model(program, state_names=names, input_names=["u"], contract=False)
    fused = compile_model(program, state_names=names, input_names=["u"])
    traced = trace_model(program, state_names=names, input_names=["u"])
    for point in np.random.default_rng(seed).normal(size=(5, 6)):
        derivative, outputs = program(point.tolist(), [0.7])
        np.testing.assert_array_equal(exact.derivative(point, [0.7]), derivative)
        np.testing.assert_array_equal(exact.outputs(point, [0.7]), outputs)
        np.testing.assert_allclose(fused.outputs(point, [0.7]), outputs, rtol=1e-11, atol=1e-11)
        given = {f"state.{name}": value for name, value in zip(names, point, strict=True)} | {"input.u": 0.7}
        np.testing.assert_array_equal(np.array(interpret(traced.outputs, given)), outputs)
