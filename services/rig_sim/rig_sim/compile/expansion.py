"""Write transcendental functions as sums and products, so that they run in the lanes of vectors.

A call of the mathematical library computes one lane at a time, and every register must be saved around it. Here a
traced model is copied with each function as a reduction of its argument to near zero and a polynomial, without
branches: errors stay within a few units in the last place for all finite arguments (tests compare with numpy). The
sign of a zero is lost; an angle beyond 2^50 rad, whose last digit is a fifth of a radian, gives NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction

from rig_sim.compile.operations import Operation
from rig_sim.compile.tracing import Expression, Graph, TracedModel, creation_order, rebuilt

#: pi/2 and ln 2 to more digits than a double has (Abramowitz and Stegun, table 1.1).
_HALF_PI = Fraction("1.5707963267948966192313216916397514420985846996875529104874722961539")
_LN_2 = Fraction("0.6931471805599453094172321214581765680755001343602552541206800094934")
_LARGEST_ANGLE = 2.0**50
_BEYOND = 1.0e300  # times an angle above that: infinite, hence NaN
_TAN_PI_8 = math.sqrt(2.0) - 1.0
_SMALLEST = 5.0e-324
# Arguments at which the exponential is 0 or infinite, and the hyperbolic tangent is 1, to the last digit.
_LOWEST_POWER, _HIGHEST_POWER, _SATURATED = -746.0, 710.0, 20.0


def _parts(number: Fraction, count: int, *, bits: int = 53) -> list[float]:
    """Split a number into positive doubles of decreasing size that add up to it."""
    parts = []
    for _ in range(count):
        unit = Fraction(2) ** (math.frexp(float(number))[1] - bits)
        part = number // unit * unit
        parts.append(float(part))
        number -= part
    return parts


# Polynomials that meet their function at Chebyshev's points of the interval that a reduced argument is in: half the
# terms of a Taylor series for less than a fifth of a last digit.
#: (sin(x)/x - 1)/x^2 of x^2, within pi/4.
_SINE = (
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836756774,
    2.7557316101617874e-06,
    -2.505113165023518e-08,
    1.5918115263266013e-10,
)
#: (cos(x) - 1)/x^2 of x^2, within pi/4.
_COSINE = (
    -0.5,
    0.04166666666666664,
    -0.001388888888888077,
    2.4801587293690305e-05,
    -2.755731556524682e-07,
    2.0875886564482672e-09,
    -1.1367988423294993e-11,
)
#: (e^x - 1 - x)/x^2 of x, within ln 2 / 2.
_EXPONENTIAL = (
    0.5000000000000001,
    0.16666666666666669,
    0.04166666666662413,
    0.008333333333330062,
    0.0013888888917213717,
    0.00019841269863053618,
    2.4801521295954376e-05,
    2.7557268459997064e-06,
    2.762008844540978e-07,
    2.510038549551034e-08,
)
#: (atan(x)/x - 1)/x^2 of x^2, within tan(pi/8).
_ARCTANGENT = (
    -0.3333333333333333,
    0.19999999999995516,
    -0.14285714284665682,
    0.11111111015187018,
    -0.0909090457530649,
    0.07692183125376892,
    -0.06664510525508932,
    0.05858140904866307,
    -0.05085407834589426,
    0.03923044778479276,
    -0.019175404711105896,
)


def expanded(traced: TracedModel, *, roots_by_products: bool = False) -> TracedModel:
    """Return the model with every transcendental function written out.

    `roots_by_products`: Without the root and the division of an inverse root: of four or eight doubles they may take
    up to four times as long as of two.
    """
    expansions = _EXPANSIONS | {Operation.INVERSE_SQRT: _root_by_products} if roots_by_products else _EXPANSIONS

    def written_out(graph: Graph, node: Expression, operands: list[Expression]) -> Expression:
        expansion = expansions.get(node.operation)
        return expansion(*operands) if expansion else graph.apply(node.operation, *operands)

    return rebuilt(traced, written_out)


def _polynomial(x: Expression, coefficients: Sequence[float]) -> Expression:
    """Return the sum of the coefficients times rising powers of x."""
    total = x.graph.constant(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


def _floor(x: Expression) -> Expression:
    return x.graph.apply(Operation.FLOOR, x)


def _fused(a: Expression, b: float, c: Expression) -> Expression:
    """Return a*b + c with one rounding, also if products and sums are not fused elsewhere."""
    return a.graph.apply(Operation.FUSED, a, b, c)


def _select(condition: Expression, positive: Expression | float, negative: Expression | float) -> Expression:
    return condition.graph.apply(Operation.SELECT_POSITIVE, condition, positive, negative)


def _quarters(angle: Expression) -> tuple[Expression, Expression]:
    """Return the number of quarter turns in an angle, and the rest, within pi/4.

    The first of three subtractions is exact: both terms are multiples of 2^-52 and their difference is below 1 (Boldo,
    Daumas and Li, Formally Verified Argument Reduction with a Fused Multiply-Add, IEEE Trans. Comput. 58, 2009).
    """
    angle = angle * _select(_LARGEST_ANGLE - abs(angle), 1.0, _BEYOND)
    turns = _floor(angle * float(1 / _HALF_PI) + 0.5)
    left = angle
    for part in _parts(_HALF_PI, 3):
        left = _fused(turns, -part, left)
    return turns, left


def _both(angle: Expression) -> tuple[Expression, Expression, Expression, Expression]:
    """Return sine and cosine of the rest of an angle, whether they are exchanged, and the sine's sign."""
    turns, left = _quarters(angle)
    square = left * left
    sine = left + left * (square * _polynomial(square, _SINE))
    cosine = 1.0 + square * _polynomial(square, _COSINE)
    quadrant = turns - 4.0 * _floor(turns * 0.25)
    half = _floor(quadrant * 0.5)
    return sine, cosine, quadrant - 2.0 * half, 1.0 - 2.0 * half


def _sine(angle: Expression) -> Expression:
    sine, cosine, odd, sign = _both(angle)
    return sign * _select(odd - 0.5, cosine, sine)


def _cosine(angle: Expression) -> Expression:
    sine, cosine, odd, sign = _both(angle)
    return sign * (1.0 - 2.0 * odd) * _select(odd - 0.5, sine, cosine)


def _powers(x: Expression) -> tuple[Expression, Expression]:
    """Return n and e^r - 1 of x = n ln 2 + r, r within ln 2 / 2."""
    whole = _floor(x * float(1 / _LN_2) + 0.5)
    left = x
    for part in _parts(_LN_2, 2, bits=42):  # n has 11 bits: the product with the first part is exact
        left = _fused(whole, -part, left)
    return whole, left + left * left * _polynomial(left, _EXPONENTIAL)


def _power_of_two(whole: Expression) -> Expression:
    return whole.graph.apply(Operation.POWER_OF_TWO, whole)


def _clamped(x: Expression, lowest: float, highest: float) -> Expression:
    return x.graph.apply(Operation.MINIMUM, x.graph.apply(Operation.MAXIMUM, x, lowest), highest)


def _exponential(x: Expression) -> Expression:
    whole, less_one = _powers(_clamped(x, _LOWEST_POWER, _HIGHEST_POWER))
    # In two factors: the power itself may underflow or overflow.
    half = _floor(whole * 0.5)
    return (1.0 + less_one) * _power_of_two(half) * _power_of_two(whole - half)


def _hyperbolic_tangent(x: Expression) -> Expression:
    whole, less_one = _powers(2.0 * _clamped(x, -_SATURATED, _SATURATED))
    power = _power_of_two(whole)
    difference = power * less_one + (power - 1.0)
    return difference / (difference + 2.0)


def _angle_of_point(y: Expression, x: Expression) -> Expression:
    across, along = abs(y), abs(x)
    graph = y.graph
    # By one comparison, and not as minimum and maximum: it costs a third, and a NaN of either stays one.
    flat = along - across
    short, long = _select(flat, across, along), _select(flat, along, across)
    # Above pi/8 relative to pi/4; one quotient is enough for both.
    narrow = _TAN_PI_8 * long - short
    top = _select(narrow, short, short - long)
    tangent = top / graph.apply(Operation.MAXIMUM, _select(narrow, long, short + long), _SMALLEST)
    square = tangent * tangent
    half_pi = float(_HALF_PI)
    angle = _select(narrow, 0.0, 0.5 * half_pi) + (tangent + tangent * (square * _polynomial(square, _ARCTANGENT)))
    angle = _select(flat, angle, half_pi - angle)
    angle = _select(x, angle, 2.0 * half_pi - angle)
    return _select(y, angle, -angle)


def _inverse_sine(x: Expression) -> Expression:
    return _angle_of_point(x, x.graph.apply(Operation.SQRT, (1.0 - x) * (1.0 + x)))


def _one_over_root(x: Expression) -> Expression:
    return 1.0 / x.graph.apply(Operation.SQRT, x)


def _root_by_products(x: Expression) -> Expression:
    """Return one over the root by Newton's steps from an estimate: relative errors of 3e-2, 2e-3, 5e-6, 3e-11 and 0."""
    half = 0.5 * x
    root = x.graph.apply(Operation.INVERSE_SQRT_ESTIMATE, x)
    for _ in range(3):
        root = root * (1.5 - half * (root * root))
    # The last step adds a small correction, so that only its own rounding counts.
    return root + (0.5 * root) * (1.0 - (x * root) * root)


_EXPANSIONS: dict[Operation, Callable[..., Expression]] = {
    Operation.SIN: _sine,
    Operation.COS: _cosine,
    Operation.EXP: _exponential,
    Operation.TANH: _hyperbolic_tangent,
    Operation.ATAN2: _angle_of_point,
    Operation.ASIN: _inverse_sine,
    Operation.INVERSE_SQRT: _one_over_root,
}


def numbers_written_out() -> Iterator[float]:
    """Return the magnitudes of the constants in written-out functions."""
    graph = Graph()
    x, y = graph.input("x"), graph.input("y")
    functions = [graph.apply(function, *((x, y) if function is Operation.ATAN2 else (x,))) for function in _EXPANSIONS]
    written = expanded(TracedModel((x, y), (), tuple(functions), ()))
    return (abs(node.value) for node in creation_order(written.derivative) if node.value is not None)
