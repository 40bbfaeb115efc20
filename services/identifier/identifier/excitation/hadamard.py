"""Hadamard matrices: signs that decorrelate as many drives as the matrix has rows."""

from functools import cache

import numpy as np
from numpy.typing import NDArray


def hadamard_matrix(order: int) -> NDArray[np.float64]:
    """Return a matrix of +1 and -1 with orthogonal rows.

    Parameters
    ----------
    order
        1, 2, one more than a prime that is 3 modulo 4 (Paley I: 4, 8, 12, 20, 24, ...), twice one more than a prime
        that is 1 modulo 4 (Paley II: 12, 28, 36, ...), or twice another order (Sylvester).

    Returns
    -------
    numpy.ndarray
        Matrix, shape (order, order).

    Raises
    ------
    ValueError
        No construction gives the order; `nearest_hadamard_order` returns the nearest possible one.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 8 and 9 (Sylvester); R. E. A. C. Paley, "On orthogonal matrices", J. Math.
    Phys. 12 (1933), only the fields with a prime number of elements.
    """
    if not _exists(order):
        raise ValueError(
            f"No Hadamard matrix of order {order} is made here; take {nearest_hadamard_order(max(order, 1))}."
        )
    if order == 1:
        return np.ones((1, 1))
    if order == 2 or _exists(order // 2):
        # Sylvester first if both exist: its rows are those of the paper.
        return np.asarray(np.kron([[1.0, 1.0], [1.0, -1.0]], hadamard_matrix(order // 2)), dtype=np.float64)
    return _paley_one(order - 1) if _is_paley_one(order) else _paley_two(order // 2 - 1)


def nearest_hadamard_order(drives: int) -> int:
    """Return the smallest order with at least as many rows as there are drives.

    `drives`: 1 or more.
    Returns: An order that `hadamard_matrix` makes.
    """
    order = drives
    while not _exists(order):
        order += 1
    return order


def sign_matrix(drives: int) -> NDArray[np.float64]:
    """Return the signs of each drive in each experiment: upper rows of the nearest Hadamard matrix, all columns.

    The square corner alone is not enough: of order 8, its 6 by 6 corner leaves a coherence of 1/3 between drives.

    Parameters
    ----------
    drives
        1 or more.

    Returns
    -------
    numpy.ndarray
        Shape (drives, experiments), +1 and -1, with orthogonal rows.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, section "Hadamard".
    """
    return np.ascontiguousarray(hadamard_matrix(nearest_hadamard_order(drives))[:drives])


@cache
def _exists(order: int) -> bool:
    if order in (1, 2):
        return True
    if order < 4 or order % 4 != 0:
        return False
    return _is_paley_one(order) or _is_paley_two(order) or _exists(order // 2)


def _is_paley_one(order: int) -> bool:
    return (order - 1) % 4 == 3 and _is_prime(order - 1)


def _is_paley_two(order: int) -> bool:
    return (order // 2 - 1) % 4 == 1 and _is_prime(order // 2 - 1)


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % divisor for divisor in range(2, int(number**0.5) + 1))


def _paley_one(prime: int) -> NDArray[np.float64]:
    """Return the identity plus the bordered, skew Jacobsthal matrix."""
    skew = np.zeros((prime + 1, prime + 1))
    skew[0, 1:], skew[1:, 0], skew[1:, 1:] = 1.0, -1.0, _jacobsthal(prime)
    return np.eye(prime + 1) + skew


def _paley_two(prime: int) -> NDArray[np.float64]:
    """Return the symmetric conference matrix with each element replaced by a two by two block."""
    conference = np.zeros((prime + 1, prime + 1))
    conference[0, 1:], conference[1:, 0], conference[1:, 1:] = 1.0, 1.0, _jacobsthal(prime)
    return np.kron(conference, np.array([[1.0, 1.0], [1.0, -1.0]])) + np.kron(
        np.eye(prime + 1), np.array([[1.0, -1.0], [-1.0, -1.0]])
    )


def _jacobsthal(prime: int) -> NDArray[np.float64]:
    """Return the quadratic character of each pair's difference: 1 for a square, -1 for none, 0 on the diagonal."""
    elements = np.arange(prime)
    character = np.full(prime, -1.0)
    character[(elements**2) % prime] = 1.0
    character[0] = 0.0
    return character[(elements[:, None] - elements[None, :]) % prime]
