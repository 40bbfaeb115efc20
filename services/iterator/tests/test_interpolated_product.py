import numpy as np
from scipy.interpolate import CubicSpline

from iterator.model import InterpolatedMatrix


def test_each_line_is_multiplied_with_the_matrix_that_a_spline_lays_there():
    rng = np.random.default_rng(1)
    known = np.sort(rng.uniform(1.0, 40.0, 17))
    matrix = rng.standard_normal((17, 3, 2)) + 1j * rng.standard_normal((17, 3, 2))
    # Lines on the known ones too, and pieces without any line.
    at = np.sort(np.concatenate([rng.uniform(known[0], known[-1], 5000), known[[0, 5, -1]]]))
    at = at[(at < known[8]) | (at > known[10])]
    spectrum = rng.standard_normal((2, at.size)) + 1j * rng.standard_normal((2, at.size))
    wider = np.zeros((3, at.size + 7), dtype=np.complex128)
    InterpolatedMatrix(known, matrix, at=at).times(spectrum, out=wider[:, 4:-3])
    expected = np.einsum("fij,jf->if", CubicSpline(known, matrix, axis=0)(at), spectrum)
    np.testing.assert_allclose(wider[:, 4:-3], expected, rtol=0.0, atol=1e-12 * np.max(np.abs(expected)))
    assert not wider[:, :4].any()
    assert not wider[:, -3:].any()
