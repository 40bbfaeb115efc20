"""Least squares at each line from averaged spectra, anchored at a matrix that was known before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.model import StepSpectra

# A fit that leaves less than this share of what the anchor does not explain contradicts it: its prior is weakened.
_CONTRADICTED: Final = 0.3
# Of the prior strength asked for: it never gets weaker than that, whatever the steps say.
_WEAKEST_PRIOR: Final = 0.1
# Share of the responses' energy below which a residual is rounding.
_ROUNDING: Final = 1e-12
# Prior strength of the further inputs, whose anchor is zero, relative to the energy of each: it holds the solution
# together where they resemble each other, and keeps 3 % of what they do from them.
_FURTHER_PRIOR: Final = 0.03


@dataclass(frozen=True)
class AnchoredSteps:
    """Spectra of inputs and responses, all in scaled units, with what is known of the matrix between them.

    `inputs`, shape (lines, n_v, n_v): The drives' cross-spectra, behind them those of further inputs.
    `responses_with_inputs`, shape (lines, n_y, n_v): Cross-spectra. `responses`, shape (lines, n_y): Auto-spectra.
    `weight`, shape (n_y,): How a response's energy counts among others, 0 or more. `anchor`, shape (lines, n_y, n_u):
    Of the drives; of further inputs it is 0. `prior`, shape (lines, n_u, n_u): The spectrum of the drives that the
    anchor was identified with, up to a factor.
    """

    inputs: NDArray[np.complex128]
    responses_with_inputs: NDArray[np.complex128]
    responses: NDArray[np.float64]
    weight: NDArray[np.float64]
    anchor: NDArray[np.complex128]
    prior: NDArray[np.complex128]

    @property
    def drives(self) -> int:
        """Drives, the first of the inputs."""
        return self.anchor.shape[2]

    def of_drives_alone(self) -> AnchoredSteps:
        """Return the same without further inputs."""
        own = slice(self.drives)
        return AnchoredSteps(
            np.ascontiguousarray(self.inputs[:, own, own]),
            np.ascontiguousarray(self.responses_with_inputs[:, :, own]),
            self.responses,
            self.weight,
            self.anchor,
            self.prior,
        )

    def fit(self, prior_strength: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Fit all inputs, the prior weakened where the steps contradict the anchor."""
        further = self.inputs.shape[1] - self.drives
        anchor = np.concatenate((self.anchor, np.zeros((*self.anchor.shape[:2], further), dtype=np.complex128)), axis=2)
        discrepancy = self.responses_with_inputs - np.matmul(anchor, self.inputs)
        by_anchor = self.unexplained(anchor) @ self.weight
        known = by_anchor > _ROUNDING * (self.responses @ self.weight)
        # Judged by the fit with the weakest prior: a strong one hides how well another matrix would explain the steps.
        free = self._spread(np.full(by_anchor.size, prior_strength * _WEAKEST_PRIOR))
        left = np.ones_like(by_anchor)
        explained_freely = self.unexplained(anchor + np.matmul(discrepancy, free)) @ self.weight
        np.divide(explained_freely, by_anchor, out=left, where=known)
        spread = self._spread(prior_strength * np.clip(left / _CONTRADICTED, _WEAKEST_PRIOR, 1.0))
        return anchor + np.matmul(discrepancy, spread), spread

    def unexplained(self, by: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return what a matrix leaves of the responses' energy; 0 where rounding would make it negative."""
        return StepSpectra(self.responses_with_inputs, self.inputs, self.responses).unexplained(by)

    def _spread(self, strength: NDArray[np.float64]) -> NDArray[np.complex128]:
        """`P = (S̄_ΔuΔu + Λ)⁻¹`; of the drives the inverse of the prior at lines without any motion."""
        n_u = self.drives
        power = np.einsum("fii->fi", self.inputs).real
        energy, reference = np.sum(power[:, :n_u], axis=1), np.einsum("fii->f", self.prior).real
        moved = (energy > 0.0) & (reference > 0.0)
        share = np.divide(strength * energy, reference, out=np.ones_like(energy), where=moved)
        matrix = self.inputs.copy()
        matrix[:, :n_u, :n_u] += share[:, None, None] * self.prior
        further = np.arange(n_u, power.shape[1])
        own = power[:, n_u:]
        matrix[:, further, further] += np.where(own > 0.0, _FURTHER_PRIOR * own, 1.0)
        # The units of further inputs are others than the drives': levelled, the inversion does not see them.
        diagonal = np.einsum("fii->fi", matrix).real
        level = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)
        try:
            inverse = np.linalg.inv(matrix * level[:, :, None] * level[:, None, :])
        except np.linalg.LinAlgError as error:
            raise ValueError(
                "The identification's drives leave a direction at a line of the control band without energy; identify "
                "with as many independent experiments as drives."
            ) from error
        return np.asarray(inverse * level[:, :, None] * level[:, None, :], dtype=np.complex128)
