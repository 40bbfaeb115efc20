"""The tracer: one node per expression, exact identities, errors instead of wrong numbers."""

import math
import operator

import numpy as np
import pytest

from rig_sim.compile import Graph, cos, maximum, minimum, select_positive, sin, sqrt, tanh
from rig_sim.compile.operations import Operation
from rig_sim.compile.tracing import creation_order


@pytest.fixture
def graph():
    return Graph()


@pytest.fixture
def xyz(graph):
    return tuple(graph.input(name) for name in "xyz")


def test_equal_expressions_are_one_node(xyz):
    x, y, z = xyz
    assert x * y + z is z + y * x
    assert sin(x * y) is sin(y * x)
    assert minimum(x, y) is minimum(y, x)
    assert x - y is not x + y
    assert (x - y) * z is not (y - x) * z


def test_an_input_of_one_name_is_one_node(graph):
    assert graph.input("speed") is graph.input("speed")


@pytest.mark.parametrize(
    "identity",
    [
        lambda x, y: (x + 0.0, x),
        lambda x, y: (0 - x, -x),
        lambda x, y: (x - 0, x),
        lambda x, y: (1 * x, x),
        lambda x, y: (-1.0 * x, -x),
        lambda x, y: (x / 1, x),
        lambda x, y: (x / -1, -x),
        lambda x, y: (x / 4.0, 0.25 * x),
        lambda x, y: (x**0, x.graph.constant(1.0)),
        lambda x, y: (x**1, x),
        lambda x, y: (x**2, x * x),
        lambda x, y: (x**-2, 1 / (x * x)),
        lambda x, y: (x**0.5, sqrt(x)),
        lambda x, y: (x**2.5, x * x * sqrt(x)),
        lambda x, y: (x**-0.5, 1 / sqrt(x)),
        lambda x, y: (0.0 * x, x.graph.constant(0.0)),
        lambda x, y: (0.0 / x, x.graph.constant(0.0)),
        lambda x, y: (x - x, x.graph.constant(0.0)),
        lambda x, y: ((x + y) / (y + x), x.graph.constant(1.0)),
        lambda x, y: (-operator.neg(x), x),
        lambda x, y: (x + -y, x - y),
        lambda x, y: (-x + y, y - x),
        lambda x, y: (-x - y, -(x + y)),
        lambda x, y: (x - -y, x + y),
        lambda x, y: (x + -3.0, x - 3.0),
        lambda x, y: (-x * y, -(x * y)),
        lambda x, y: (-x * -y, x * y),
        lambda x, y: (-2.0 * x, -(2.0 * x)),
        lambda x, y: (-x / y, -(x / y)),
        lambda x, y: (x / -y, -(x / y)),
        lambda x, y: (sin(-x), -sin(x)),
        lambda x, y: (tanh(-x), -tanh(x)),
        lambda x, y: (cos(-x), cos(x)),
        lambda x, y: (abs(-x), abs(x)),
        lambda x, y: (abs(abs(x)), abs(x)),
        lambda x, y: (minimum(x, x), x),
        lambda x, y: (select_positive(y, x, x), x),
        lambda x, y: (select_positive(-1e-300, x, y), y),
        lambda x, y: (select_positive(-0.0, x, y), x),
        lambda x, y: (sin(x.graph.constant(0.0)) * x + y, y),
    ],
)
def test_an_identity_folds_to_the_simpler_expression(xyz, identity):
    left, right = identity(*xyz[:2])
    assert left is right


def test_the_opposite_difference_shares_the_first_one(xyz):
    x, y, _ = xyz
    difference = x - y
    opposite = y - x
    assert opposite.operation is Operation.NEGATE
    assert opposite.operands == (difference,)


def test_division_by_a_number_that_has_no_exact_reciprocal_stays_a_division(xyz):
    assert (xyz[0] / 3.0).operation is Operation.DIVIDE
    assert (xyz[0] / 2.0**-1060).operation is Operation.DIVIDE


def test_constants_fold_to_the_number_that_python_computes(graph):
    c = graph.constant
    assert ((c(0.1) + c(0.2)) * 3.0).value == (0.1 + 0.2) * 3.0
    assert (sin(c(1.25)) ** 3).value == math.sin(1.25) * (math.sin(1.25) * math.sin(1.25))
    assert maximum(c(-2.0), -1.0).value == -1.0
    assert float(c(2.0) / 3.0) == 2.0 / 3.0
    assert graph.input("x").value is None


def test_zeros_of_both_signs_are_different_constants(graph):
    assert graph.constant(0.0) is not graph.constant(-0.0)
    assert math.copysign(1.0, graph.constant(-0.0).value) == -1.0


def test_structural_zeros_and_ones_of_object_arrays_disappear(xyz):
    rotation = np.array([[1, 0, 0], [0, cos(xyz[0]), -sin(xyz[0])], [0, sin(xyz[0]), cos(xyz[0])]], dtype=object)
    vector = np.array(xyz, dtype=object)
    turned = np.eye(3) @ rotation @ vector
    assert turned[0] is xyz[0]
    operations = [node.operation for node in creation_order(turned) if node.operands]
    assert operations.count(Operation.MULTIPLY) == 4
    assert len(operations) == 2 + 4 + 2  # sine and cosine, products, one sum and one difference


def test_arrays_and_numpy_scalars_mix_with_expressions(xyz):
    x, y, z = xyz
    numbers = np.array([2.0, 4.0, 8.0])
    products = np.float64(3.0) * x + np.int64(1) - numbers * np.array(xyz, dtype=object)
    assert products[1] is x * 3.0 + 1 - y * 4.0
    assert (x * numbers)[2] is x * 8.0
    assert (numbers - z)[0] is 2.0 - z
    assert (np.float64(2.0) / z) is 2.0 / z
    assert sum([x, y, z]) is x + y + z


def test_what_no_result_needs_is_not_evaluated(xyz):
    x, y, z = xyz
    _ = sin(z) * y
    kept = x * y
    assert [node for node in creation_order([kept]) if node.operands] == [kept]


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        (lambda g, x: bool(x), TypeError, "cannot branch"),
        (lambda g, x: x > 0, TypeError, "cannot be compared"),
        (lambda g, x: x == 0, TypeError, "cannot be compared"),
        (lambda g, x: float(x), TypeError, "no number yet"),
        (lambda g, x: x**1.3, TypeError, "exponent 1.3"),
        (lambda g, x: x**x, TypeError, "exponent"),
        (lambda g, x: x + "1", TypeError, "str cannot be traced"),
        (lambda g, x: x + math.nan, ValueError, "nan .* is not finite"),
        (lambda g, x: x * math.inf, ValueError, "inf .* is not finite"),
        (lambda g, x: x / 0.0, ValueError, "divided by the constant 0"),
        (lambda g, x: sqrt(g.constant(-1.0)), ValueError, r"sqrt\(-1.0,\)"),
        (lambda g, x: g.constant(1.0) / 0, ValueError, "no finite value"),
        (lambda g, x: x + Graph().input("y"), ValueError, "another graph"),
    ],
)
def test_what_cannot_be_traced_is_refused(graph, wrong, error, message):
    with pytest.raises(error, match=message):
        wrong(graph, graph.input("x"))
