import numpy as np
import pytest

from rig_sim.compile import (
    Many,
    absolute,
    asin,
    at_once,
    atan2,
    clamp,
    cos,
    exp,
    numeric,
    select_positive,
    sin,
    sqrt,
    taken,
)
from rig_sim.compile import tanh as hyperbolic
from rig_sim.loading import load_any_rig
from rig_sim.specimen import shipped_specimens


def everything(x, y):
    """Use every operator and every function once at least, with numbers on both sides."""
    frame = np.array([[1.0, 2.0], [0.5, -1.0]]) @ np.array([x, y])
    some = 2.0 - x + 3.0 * y - x / (2.0 + y * y) + 1.0 / (1.0 + x**2) - (+y) + frame[0] * frame[1]
    return [
        some,
        abs(x) + absolute(y) + (x * x + 0.1) ** 0.5,
        sqrt(x * x) + exp(-y) + hyperbolic(x) + sin(x) * cos(y) + asin(0.1 * y) + atan2(y, x),
        clamp(x, -0.5, y) + numeric.minimum(x, 0.0) + select_positive(x, -y, y),
        1.5,
    ]


def test_many_states_at_once_are_those_one_by_one():
    rows = np.random.default_rng(1).standard_normal((50, 2))
    together = everything(*at_once(rows))
    for instant, row in enumerate(rows):
        np.testing.assert_allclose(taken(together, instant), everything(*map(float, row)), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["front_axle", "predecessor"])
def test_a_rig_is_the_same_at_once_and_one_by_one(name):
    model = load_any_rig(shipped_specimens()[name]).model
    rng = np.random.default_rng(2)
    states = model.design_state + 0.01 * rng.standard_normal((3, len(model.design_state)))
    inputs = 0.01 * rng.standard_normal((3, len(model.input_names)))
    together = model.evaluate(at_once(states), at_once(inputs)).derivative
    for instant in range(3):
        alone = np.array(model.evaluate(states[instant], inputs[instant]).derivative, dtype=float)
        np.testing.assert_allclose(taken(together, instant), alone, rtol=0, atol=1e-12 * np.max(np.abs(alone)))


def test_a_model_that_branches_on_many_numbers_is_refused():
    many = Many(np.array([1.0, -1.0]))
    with pytest.raises(TypeError, match="cannot branch on many numbers"):
        bool(many)
    with pytest.raises(TypeError, match="cannot be compared"):
        _ = many > 0.0
