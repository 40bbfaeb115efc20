"""Terms of a drive map, and the order in which drives depend on each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

COEFFICIENTS: Final = 3
"""Number of coefficients of a term: value, rate and acceleration of the product."""
_UNIT_FREQUENCY: Final = 10.0
"""Frequency in Hz at which all coefficients have the same weight."""


@dataclass(frozen=True)
class MapTerm:
    """Product of two drives that one drive follows.

    Parameters
    ----------
    follower : int
        Index of the drive that follows the product.
    product : tuple of int
        Indices of the two drives of the product, rising or equal.
    coefficients : tuple of float
        `c_m` of `K(ω) = Σ_m c_m (jω/ω0)^m`, no unit, `ω0 = 2π·10/s`; three finite values.

    Raises
    ------
    ValueError
        If an index is negative, the product is not in rising order, or a coefficient is not finite.
    """

    follower: int
    product: tuple[int, int]
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        first, second = self.product
        if not (0 <= first <= second and self.follower >= 0):
            raise ValueError(
                f"A term has the follower {self.follower} and the product {self.product}; indices of drives start at 0 "
                "and those of a product rise."
            )
        if len(self.coefficients) != COEFFICIENTS or not np.all(np.isfinite(self.coefficients)):
            raise ValueError(f"A term has the coefficients {self.coefficients}; give {COEFFICIENTS} finite numbers.")


def powers_of_frequency(frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return `(jω/ω0)^m` of each coefficient."""
    return np.asarray((1j * frequency / _UNIT_FREQUENCY) ** np.arange(COEFFICIENTS)[:, None], dtype=np.complex128)


def dependency_order(terms: Iterable[MapTerm], *, drives: int) -> tuple[int, ...] | None:
    """Return the drives so that each comes after those that it follows, or None if they follow in a cycle."""
    leaders: list[set[int]] = [set() for _ in range(drives)]
    for term in terms:
        leaders[term.follower].update(term.product)
    order: list[int] = []
    while len(order) < drives:
        ready = next((i for i in range(drives) if i not in order and leaders[i] <= set(order)), None)
        if ready is None:
            return None
        order.append(ready)
    return tuple(order)


def closes_cycle(follower: int, product: Sequence[int], terms: Sequence[MapTerm]) -> bool:
    """Return whether a further term would make a drive follow itself, directly or through other drives."""
    reached, todo = set[int](), [follower]
    while todo:
        leader = todo.pop()
        if leader not in reached:
            reached.add(leader)
            todo += [term.follower for term in terms if leader in term.product]
    return any(drive in reached for drive in product)


def unit_of_ratio(unit: str, *, over: Sequence[str]) -> str:
    """Return the unit of a coefficient: one unit over the product of others, equal ones cancelled."""
    below = Counter(over)
    above = unit
    if below[unit]:
        below[unit] -= 1
        above = ""
    names = [_power(name, count) for name, count in below.items() if count]
    if not names:
        return above or "1"
    bottom = "·".join(names)
    return f"{above}/({bottom})" if len(names) > 1 else f"{above}/{bottom}"


def product_text(first: str, second: str) -> str:
    """Return a product of two drives as text."""
    return _power(first, 2) if first == second else f"{first} × {second}"


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}²"
