import numpy as np
import pytest
from scipy import linalg

from identifier.excitation import dft_matrix, hadamard_matrix, nearest_hadamard_order, sign_matrix


@pytest.mark.parametrize("order", [1, 2, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 56, 60, 64])
def test_a_hadamard_matrix_has_signs_only_and_orthogonal_rows(order):
    matrix = hadamard_matrix(order)
    np.testing.assert_array_equal(np.abs(matrix), np.ones((order, order)))
    np.testing.assert_array_equal(matrix @ matrix.T, order * np.eye(order))


@pytest.mark.parametrize("order", [2, 4, 8, 16])
def test_powers_of_two_are_those_of_sylvester(order):
    np.testing.assert_array_equal(hadamard_matrix(order), linalg.hadamard(order))


@pytest.mark.parametrize(
    ("drives", "order"), [(1, 1), (2, 2), (3, 4), (5, 8), (6, 8), (9, 12), (13, 16), (17, 20), (25, 28), (33, 36)]
)
def test_the_nearest_order_is_the_next_that_exists(drives, order):
    assert nearest_hadamard_order(drives) == order


@pytest.mark.parametrize("order", [0, -4, 3, 6, 52, 92])
def test_an_order_that_is_not_made_is_refused_with_one_that_is(order):
    with pytest.raises(ValueError, match=f"No Hadamard matrix of order {order} is made here; take"):
        hadamard_matrix(order)


def test_all_columns_of_six_rows_of_order_eight_are_exactly_orthogonal():
    signs = sign_matrix(6)
    assert signs.shape == (6, 8)
    np.testing.assert_array_equal(signs @ signs.T, 8.0 * np.eye(6))


def test_the_square_corner_of_order_eight_is_a_trap_of_coherence_a_third():
    corner = sign_matrix(6)[:, :6]
    off_diagonal = np.abs(corner @ corner.T / 6.0 - np.eye(6))
    assert np.max(off_diagonal) == pytest.approx(1.0 / 3.0, abs=1e-15)


@pytest.mark.parametrize("order", [1, 2, 3, 5, 6, 7, 8, 24])
def test_a_dft_matrix_has_phases_only_and_orthogonal_rows_for_every_order(order):
    matrix = dft_matrix(order)
    np.testing.assert_allclose(np.abs(matrix), 1.0, rtol=1e-15)
    np.testing.assert_allclose(matrix @ matrix.conj().T, order * np.eye(order), atol=1e-13)
