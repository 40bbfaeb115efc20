"""Product of a matrix known at a few lines with the spectra of records at many lines between them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_TERMS: Final = 4
# Lines per block, so that their powers and products together fit into the second-level cache.
_LINES_TOGETHER: Final = 2048


class InterpolatedMatrix:
    """Matrix at other lines, interpolated by a cubic spline through known lines.

    Between two known lines the matrix is `M_0 s³ + M_1 s² + M_2 s + M_3`, so its product with a line `x` is
    `[M_0 M_1 M_2 M_3]` times the stack of `s³ x`, `s² x`, `s x` and `x`: one product for all lines between two known
    ones is several times faster than a matrix for every line.

    `known`, shape (known lines,): Hz, rising. `matrix`, shape (known lines, n_out, n_in). `at`, shape (lines,): Hz,
    rising.
    """

    def __init__(self, known: NDArray[np.float64], matrix: NDArray[np.complex128], *, at: NDArray[np.float64]) -> None:
        # The import takes half a second, and a service must start at once.
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(known, matrix, axis=0)
        pieces, self._n_out, self._n_in = spline.c.shape[1:]
        coefficients = np.ascontiguousarray(spline.c.transpose(1, 2, 0, 3))
        self._coefficients = coefficients.reshape(pieces, self._n_out, _TERMS * self._n_in)
        self._bounds = np.concatenate([[0], np.searchsorted(at, known[1:-1]), [at.size]])
        # Twice each, for the real and the imaginary part, which have the same factor.
        self._offset = np.repeat(at - np.repeat(known[:-1], np.diff(self._bounds)), 2)

    def times(
        self, spectrum: NDArray[np.complex128], *, out: NDArray[np.complex128] | None = None
    ) -> NDArray[np.complex128]:
        """Multiply each line of a spectrum, shape (n_in, lines), with the matrix there; shape (n_out, lines)."""
        bounds, lines, pieces = self._bounds, spectrum.shape[1], self._coefficients.shape[0]
        product = np.empty((self._n_out, lines), dtype=np.complex128) if out is None else out
        powers = np.empty((_TERMS, self._n_in, _LINES_TOGETHER), dtype=np.complex128)
        parts = powers.view(np.float64)
        stack = powers.reshape(_TERMS * self._n_in, _LINES_TOGETHER)
        for start in range(0, lines, _LINES_TOGETHER):
            end = min(start + _LINES_TOGETHER, lines)
            powers[-1, :, : end - start] = spectrum[:, start:end]
            filled = slice(2 * (end - start))
            for term in reversed(range(_TERMS - 1)):
                np.multiply(parts[term + 1, :, filled], self._offset[2 * start : 2 * end], out=parts[term, :, filled])
            for piece in range(int(np.searchsorted(bounds, start, side="right")) - 1, pieces):
                first, last = max(start, int(bounds[piece])), min(end, int(bounds[piece + 1]))
                if first >= end:
                    break
                if first < last:
                    np.matmul(
                        self._coefficients[piece], stack[:, first - start : last - start], out=product[:, first:last]
                    )
        return product
