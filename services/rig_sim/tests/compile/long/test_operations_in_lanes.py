"""Every operation of a model in the lanes of a vector, against the scalar code and NumPy."""

import numpy as np
import pytest
from test_lanes import compiled
from two_sided_models import OPERATIONS, two_sides


@pytest.mark.parametrize("constants", [(0.7, -0.7), (0.7, 1.3), (-0.4, -0.4)])
@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_an_operation_in_lanes_gives_what_the_scalar_code_and_numpy_give(name, constants):
    model = two_sides(OPERATIONS[name], constants)
    lanes, scalar = compiled(model), compiled(model, lanes=False)
    assert (lanes.lanes, scalar.lanes) == (2, 1)
    rng = np.random.default_rng(4)
    for _ in range(20):
        state, inputs = rng.uniform(-3.0, 3.0, 4), rng.normal(size=2)
        plain = [np.array(values, dtype=float) for values in model(state, inputs)]
        for other, values in ((scalar.derivative, plain[0]), (scalar.outputs, plain[1])):
            ours = (lanes.derivative if values is plain[0] else lanes.outputs)(state, inputs)
            scale = np.abs(values).max()
            np.testing.assert_allclose(ours, values, rtol=1e-13, atol=1e-13 * scale)
            np.testing.assert_allclose(ours, other(state, inputs), rtol=1e-13, atol=1e-13 * scale)
