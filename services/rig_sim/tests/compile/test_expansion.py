"""Transcendental functions written out: near every double's value, wherever the argument lies; numpy is the oracle."""

import math
from fractions import Fraction

import numpy as np
import pytest

from rig_sim.compile import asin, atan2, compile_model, cos, exp, expansion, sin, tanh, trace_model
from rig_sim.compile.expansion import expanded
from rig_sim.compile.operations import Operation
from rig_sim.compile.tracing import creation_order

RNG = np.random.default_rng(3)
COUNT = 4000
TINY_TO_HUGE = 10.0 ** RNG.uniform(-300.0, 15.0, COUNT) * RNG.choice([-1.0, 1.0], COUNT)
QUARTERS = np.concatenate([np.arange(-400, 400), 2.0 ** np.arange(10, 49)]) * (math.pi / 4.0)
#: A quarter turn's multiples, and the doubles beside them: what is left of the angle is tiny.
ANGLES = np.concatenate(
    [RNG.normal(size=COUNT), TINY_TO_HUGE, QUARTERS, np.nextafter(QUARTERS, 9e99), np.nextafter(QUARTERS, -9e99)]
)
POWERS = np.concatenate([RNG.uniform(-707.0, 709.7, COUNT), RNG.normal(size=COUNT), 10.0 ** RNG.uniform(-300, 0, 500)])
SHARES = np.concatenate([RNG.uniform(-1.0, 1.0, COUNT), 1.0 - 10.0 ** RNG.uniform(-16.0, 0.0, COUNT), [1.0, -1.0]])
REACH = np.concatenate([RNG.uniform(-25.0, 25.0, COUNT), RNG.normal(size=COUNT) * 0.1, TINY_TO_HUGE])
WAYS = np.concatenate(
    [RNG.normal(size=(2, COUNT)), 10.0 ** RNG.uniform(-140, 140, (2, COUNT)) * RNG.choice([-1.0, 1.0], (2, COUNT))],
    axis=1,
)


def compiled(operation, arguments, *, contract=True):
    """Evaluate an operation for arguments (operands, points), point by point as one model with two states a point."""
    model = compile_model(
        lambda state, inputs: ([operation(*inputs)], []),
        state_names=["x"],
        input_names=[f"u{i}" for i in range(len(arguments))],
        contract=contract,
    )
    return np.array([model.derivative([0.0], point)[0] for point in arguments.T])


@pytest.mark.parametrize("contract", [True, False], ids=["fused", "unfused"])
@pytest.mark.parametrize(
    ("operation", "oracle", "arguments", "last_places"),
    [
        (sin, np.sin, ANGLES[None], 2),
        (cos, np.cos, ANGLES[None], 2),
        (tanh, np.tanh, REACH[None], 4),
        (exp, np.exp, POWERS[None], 2),
        (asin, np.arcsin, SHARES[None], 3),
        (atan2, np.arctan2, WAYS, 3),
    ],
)
def test_a_function_is_right_to_a_few_units_in_the_last_place(operation, oracle, arguments, last_places, contract):
    expected = oracle(*arguments)
    error = np.abs(compiled(operation, arguments, contract=contract) - expected) / np.spacing(np.abs(expected))
    assert error.max() <= last_places, arguments[:, error.argmax()]


def test_the_exponential_reaches_from_zero_through_subnormal_numbers_to_infinity():
    powers = np.array([[-1e300, -746.0, -745.0, -720.0, 709.78, 709.79, 1e300]])
    with np.errstate(over="ignore", under="ignore"):
        np.testing.assert_allclose(compiled(exp, powers), np.exp(powers[0]), rtol=1e-15, atol=5e-324)


@pytest.mark.parametrize("operation", [sin, cos])
@pytest.mark.parametrize("angle", [1.2e15, -1.2e15, 1e22, 1e300, math.inf, -math.inf])
def test_an_angle_without_digits_left_is_not_a_number(operation, angle):
    assert np.isnan(compiled(operation, np.array([[angle]]))).all()


def test_axes_and_the_origin_have_their_angles():
    y, x = np.array([[0.0, 0.0, 0.0, 1.0, -1.0, 3.0], [0.0, 1.0, -1.0, 0.0, 0.0, -3.0]])
    np.testing.assert_array_equal(compiled(atan2, np.array([y, x])), np.arctan2(y, x))


@pytest.mark.parametrize("value", [1.0001, -1.0001, 7.0])
def test_an_inverse_sine_of_no_sine_is_not_a_number(value):
    assert np.isnan(compiled(asin, np.array([[value]]))).all()


@pytest.mark.parametrize(
    ("polynomial", "series", "squared", "widest"),
    [
        (expansion._SINE, lambda k: Fraction((-1) ** k, math.factorial(2 * k + 1)), True, math.pi / 4),
        (expansion._COSINE, lambda k: Fraction((-1) ** k, math.factorial(2 * k)), True, math.pi / 4),
        (expansion._EXPONENTIAL, lambda k: Fraction(1, math.factorial(k + 1)), False, math.log(2.0) / 2),
        (expansion._ARCTANGENT, lambda k: Fraction((-1) ** k, 2 * k + 1), True, math.sqrt(2.0) - 1.0),
    ],
    ids=["sine", "cosine", "exponential", "arctangent"],
)
def test_a_polynomial_is_its_function_to_a_fifth_of_the_last_digit(polynomial, series, squared, widest):
    # The functions are sin(x)/x, cos(x), (e^x - 1)/x and atan(x)/x, of x or of its square; Taylor's series of 80 terms.
    terms = [series(k) for k in range(80)]
    for x in np.linspace(-widest, widest, 101):
        variable = Fraction(x) ** 2 if squared else Fraction(x)
        function = sum(term * variable**k for k, term in enumerate(terms))
        ours = 1 + variable * sum(Fraction(term) * variable**k for k, term in enumerate(polynomial))
        assert abs(float(ours / function - 1)) < 0.2 * 2.0**-52


def test_nothing_is_left_to_the_library_and_sine_and_cosine_share_their_work():
    def model(state, inputs):
        return [sin(state[0]), cos(state[0])], [tanh(state[0]), exp(state[1]), asin(state[0]), atan2(*state)]

    traced = expanded(trace_model(model, state_names=["a", "b"], input_names=[]))
    operations = {node.operation for node in creation_order((*traced.derivative, *traced.outputs))}
    assert not operations & {
        *(Operation.SIN, Operation.COS, Operation.TANH, Operation.EXP, Operation.ASIN, Operation.ATAN2)
    }
    alone, both = (len(creation_order(results)) for results in (traced.derivative[:1], traced.derivative))
    assert both < alone + 8
