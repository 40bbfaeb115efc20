"""Least squares at each line from averaged spectra, anchored at a known matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.model import StepSpectra

# A fit that leaves less than this share of the energy unexplained by the anchor contradicts it: its prior is weakened.
_CONTRADICTED: Final = 0.3
# Smallest share of the requested prior strength, for any steps.
_WEAKEST_PRIOR: Final = 0.1
# Share of the responses' energy below which a residual is rounding.
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class AnchoredSteps:
    """Spectra of inputs and responses in scaled units, with the known matrix between them.

    `inputs`, shape (lines, n_v, n_v): Cross-spectra of the drives, followed by those of further inputs.
    `responses_with_inputs`, shape (lines, n_y, n_v): Cross-spectra. `responses`, shape (lines, n_y): Auto-spectra.
    `weight`, shape (n_y,): Weight of a response's energy, 0 or more. `anchor`, shape (lines, n_y, n_u): Known matrix of
    the drives; 0 for further inputs. `prior`, shape (lines, n_u, n_u): Spectrum of the drives that the anchor was
    identified with, up to a factor. `further_prior`, shape (n_v - n_u,): Prior strength of the further inputs, whose
    anchor is zero, relative to the energy of each: it keeps the solution stable if they resemble each other.
    """

    inputs: NDArray[np.complex128]
    responses_with_inputs: NDArray[np.complex128]
    responses: NDArray[np.float64]
    weight: NDArray[np.float64]
    anchor: NDArray[np.complex128]
    prior: NDArray[np.complex128]
    further_prior: NDArray[np.float64]

    @property
    def drives(self) -> int:
        """Number of drives, which are the first inputs."""
        return self.anchor.shape[2]

    def of_drives_alone(self) -> AnchoredSteps:
        """Return the spectra without further inputs."""
        own = slice(self.drives)
        return AnchoredSteps(
            np.ascontiguousarray(self.inputs[:, own, own]),
            np.ascontiguousarray(self.responses_with_inputs[:, :, own]),
            self.responses,
            self.weight,
            self.anchor,
            self.prior,
            self.further_prior[:0],
        )

    def fit(self, prior_strength: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Fit all inputs, with a weaker prior where the steps contradict the anchor."""
        further = self.inputs.shape[1] - self.drives
        anchor = np.concatenate((self.anchor, np.zeros((*self.anchor.shape[:2], further), dtype=np.complex128)), axis=2)
        discrepancy = self.responses_with_inputs - np.matmul(anchor, self.inputs)
        by_anchor = self.unexplained(anchor) @ self.weight
        known = by_anchor > _ROUNDING * (self.responses @ self.weight)
        # From the fit with the weakest prior: a strong one hides how well another matrix explains the steps.
        free = self._spread(np.full(by_anchor.size, prior_strength * _WEAKEST_PRIOR))
        left = np.ones_like(by_anchor)
        explained_freely = self.unexplained(anchor + np.matmul(discrepancy, free)) @ self.weight
        np.divide(explained_freely, by_anchor, out=left, where=known)
        spread = self._spread(prior_strength * np.clip(left / _CONTRADICTED, _WEAKEST_PRIOR, 1.0))
        return anchor + np.matmul(discrepancy, spread), spread

    def unexplained(self, by: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the response energy that a matrix does not explain; 0 if rounding would make it negative."""
        return StepSpectra(self.responses_with_inputs, self.inputs, self.responses).unexplained(by)

    def _spread(self, strength: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return `P = (S̄_ΔuΔu + Λ)⁻¹`; the inverse of the prior for drives at lines without motion."""
        n_u = self.drives
        power = np.einsum("fii->fi", self.inputs).real
        energy, reference = np.sum(power[:, :n_u], axis=1), np.einsum("fii->f", self.prior).real
        moved = (energy > 0.0) & (reference > 0.0)
        share = np.divide(strength * energy, reference, out=np.ones_like(energy), where=moved)
        matrix = self.inputs.copy()
        matrix[:, :n_u, :n_u] += share[:, None, None] * self.prior
        further = np.arange(n_u, power.shape[1])
        own = power[:, n_u:]
        matrix[:, further, further] += np.where(own > 0.0, self.further_prior * own, 1.0)
        # Further inputs have other units than the drives: levelling removes them from the inversion.
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
