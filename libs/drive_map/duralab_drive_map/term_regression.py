"""Least squares of the residual of an FRF on the products of drives, from pieces of one record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map.frf_model import FrfModel
from duralab_drive_map.map_terms import COEFFICIENTS, powers_of_frequency
from duralab_drive_map.product_band import ProductBand
from duralab_spectra import hann_periodic

PIECE_SECONDS: Final = 8.0
"""Length of a piece in seconds; pieces overlap by half."""
_GROUP: Final = 4
# Share of the diagonal that is added to it, so that nearly equal candidates have a solution.
_RIDGE: Final = 1e-6

Candidate = tuple[int, int]
"""Index of a follower and number of a product."""


class PieceCut:
    """Division of records into Hann pieces that overlap by half, and the kept lines.

    `samples`: Length of the records. `sample_rate`: Sample rate of the records, Hz. `identified`: Lowest and highest
    frequency of the identified band, Hz.
    """

    def __init__(self, samples: int, *, sample_rate: float, identified: tuple[float, float]) -> None:
        self._band = ProductBand(samples, sample_rate=sample_rate, highest=identified[1])
        self._length = 2 * round(PIECE_SECONDS * self._band.rate / 2.0)
        lines = np.arange(self._length // 2 + 1, dtype=np.float64) * (self._band.rate / self._length)
        self._inside = (lines >= identified[0]) & (lines <= identified[1])
        self._window = hann_periodic(self._length)
        self._starts = range(0, self._band.short_samples - self._length + 1, self._length // 2)
        self.frequency: NDArray[np.float64] = lines[self._inside]
        """ndarray, shape (lines,): Frequency in Hz."""

    def lowered(self, record: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a record in the band at the rate of products of its rows."""
        return np.array([self._band.lowered(row)[: self._band.short_samples] for row in record])

    def lines(self, lowered: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the lines of each piece, shape (lines, channels, pieces)."""
        lines = np.empty((self.frequency.size, lowered.shape[0], len(self._starts)), dtype=np.complex128)
        for piece, start in enumerate(self._starts):
            cut = lowered[:, start : start + self._length] * self._window
            lines[:, :, piece] = np.fft.rfft(cut)[:, self._inside].T
        return lines


@dataclass(frozen=True)
class RecordPieces:
    """Lines of the pieces of a record and of all products of two of its drives.

    `products`: Pairs of drives, rising. `drive`, shape (lines, n_u, pieces): Drive units. `response`, shape (lines,
    n_y, pieces): Response units. `product`, shape (lines, products, pieces): In units of the drives' scale.
    `frequency`, shape (lines,): Hz. `scale`, shape (n_u,): `s`, greater than 0.
    """

    products: tuple[tuple[int, int], ...]
    drive: NDArray[np.complex128]
    response: NDArray[np.complex128]
    product: NDArray[np.complex128]
    frequency: NDArray[np.float64]
    scale: NDArray[np.float64]
    followers: NDArray[np.bool_]
    """Whether each drive may follow products, shape (n_u,)."""

    @property
    def count(self) -> int:
        """Number of pieces."""
        return int(self.drive.shape[2])


def cut_record(
    drive: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    scale: NDArray[np.float64],
    cut: PieceCut,
    followers: NDArray[np.bool_],
) -> RecordPieces:
    """Cut a record and all products of two of its drives into pieces."""
    n_u = drive.shape[0]
    lowered = cut.lowered(drive)
    products = tuple((i, k) for i in range(n_u) for k in range(i, n_u))
    scaled = lowered / scale[:, None]
    product = np.array([scaled[i] * scaled[k] for i, k in products])
    # A mean would leak into the lowest lines.
    product -= np.mean(product, axis=1, keepdims=True)
    centred = response - np.mean(response, axis=1, keepdims=True)
    return RecordPieces(
        products,
        cut.lines(lowered),
        cut.lines(cut.lowered(centred)),
        cut.lines(product),
        cut.frequency,
        scale,
        followers,
    )


def model_at(frequency: NDArray[np.float64], model: FrfModel) -> NDArray[np.complex128]:
    """Return a model's FRF at other lines of its identified band."""
    known = model.frequency[model.identified]
    # The import takes half a second, and a service must start at once.
    from scipy.interpolate import CubicSpline

    return CubicSpline(known, model.frf[model.identified], axis=0)(np.clip(frequency, known[0], known[-1]))


class TermRegression:
    """Normal equations of all candidates, of some pieces of a record; columns are computed on request.

    Minimises `|R − W H S c P|²` with `R = W (Y − H U)` over the real coefficients `c` of the chosen candidates.
    `pieces`: Pieces of the record. `used`, shape (pieces,): Whether each piece counts. `gain`, shape (lines, n_y,
    n_u): `W H S`. `residual`, shape (lines, n_y, pieces): `R`.
    """

    def __init__(
        self,
        pieces: RecordPieces,
        *,
        used: NDArray[np.bool_],
        gain: NDArray[np.complex128],
        residual: NDArray[np.complex128],
    ) -> None:
        product, own = pieces.product[:, :, used], residual[:, :, used]
        self._conjugate = product.conj()
        self._product = product
        self._power = powers_of_frequency(pieces.frequency)
        self._gram = np.matmul(gain.conj().transpose(0, 2, 1), gain)
        self.energy = float(np.sum(np.abs(own) ** 2))
        """float: `|R|²`."""
        # (lines, n_u, products): correlation of the drives that would remove the residual with the products.
        wanted = np.matmul(gain.conj().transpose(0, 2, 1), np.matmul(own, self._conjugate.transpose(0, 2, 1)))
        self.right: NDArray[np.float64] = np.einsum("mf,fap->apm", self._power.conj(), wanted).real
        """ndarray, shape (n_u, products, coefficients): Right-hand side of each candidate."""
        self._columns: dict[Candidate, NDArray[np.float64]] = {}

    @cached_property
    def blocks(self) -> NDArray[np.float64]:
        """Diagonal blocks, shape (n_u, products, coefficients, coefficients), with the ridge."""
        own = np.einsum("faa->fa", self._gram).real
        power = np.sum(np.abs(self._product) ** 2, axis=2)
        pairs = np.einsum("mf,nf->mnf", self._power.conj(), self._power)
        blocks = np.einsum("mnf,fa,fp->apmn", pairs, own, power, optimize=True).real
        diagonal = np.arange(COEFFICIENTS)
        blocks[..., diagonal, diagonal] *= 1.0 + _RIDGE
        return blocks

    def column(self, candidate: Candidate) -> NDArray[np.float64]:
        """Return the normal matrix of all candidates with one, shape (n_u, products, coefficients, coefficients)."""
        if candidate not in self._columns:
            drive, number = candidate
            shared = np.einsum("fpk,fk->fp", self._conjugate, self._product[:, number])
            pairs = np.einsum("mf,nf->mnf", self._power.conj(), self._power)
            self._columns[candidate] = np.einsum(
                "mnf,fa,fp->apmn", pairs, self._gram[:, :, drive], shared, optimize=True
            ).real
        return self._columns[candidate]

    def system(self, chosen: Sequence[Candidate]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the matrix with its ridge and the right-hand side of the chosen candidates."""
        size = COEFFICIENTS * len(chosen)
        matrix = np.empty((size, size))
        for i, (drive, number) in enumerate(chosen):
            rows = slice(COEFFICIENTS * i, COEFFICIENTS * (i + 1))
            for k, other in enumerate(chosen):
                columns = slice(COEFFICIENTS * k, COEFFICIENTS * (k + 1))
                same = other == (drive, number)
                matrix[rows, columns] = (self.blocks if same else self.column(other))[drive, number]
        return matrix, np.concatenate([self.right[each] for each in chosen])

    def gains(self, chosen: Sequence[Candidate]) -> NDArray[np.float64]:
        """Return the decrease of the residual energy by each further candidate, shape (n_u, products); 0 for none.

        It is the gain of the Schur complement: `r = b_c − C N⁻¹ b`, `S = N_c − C N⁻¹ Cᵀ`, gain `rᵀ S⁻¹ r`.
        """
        blocks, right = self.blocks, self.right
        if chosen:
            matrix, own = self.system(chosen)
            common = np.concatenate([self.column(each) for each in chosen], axis=3)
            solved = np.linalg.solve(matrix, np.concatenate((own[:, None], _rows(common).T), axis=1))
            right = right - common @ solved[:, 0]
            other = solved[:, 1:].T.reshape(*common.shape[:2], COEFFICIENTS, -1)
            blocks = blocks - np.matmul(common, other.transpose(0, 1, 3, 2))
        moved = np.einsum("apmm->ap", self.blocks) > 0.0
        safe = np.where(moved[..., None, None], blocks, np.eye(COEFFICIENTS))
        gains = np.einsum("apm,apm->ap", right, np.linalg.solve(safe, right[..., None])[..., 0])
        return np.where(moved, gains, 0.0)

    def fit(self, chosen: Sequence[Candidate]) -> NDArray[np.float64]:
        """Return the coefficients of the chosen candidates, shape (chosen × coefficients,)."""
        return np.asarray(np.linalg.solve(*self.system(chosen)), dtype=np.float64) if chosen else np.zeros(0)

    def left(self, chosen: Sequence[Candidate], coefficients: NDArray[np.float64]) -> float:
        """Return the energy that the chosen candidates leave with these coefficients."""
        if not chosen:
            return self.energy
        matrix, right = self.system(chosen)
        return self.energy + float(coefficients @ matrix @ coefficients - 2.0 * right @ coefficients)


@dataclass(frozen=True)
class Folds:
    """Normal equations of a whole record and of its two folds, alternate groups of four pieces.

    `whole`, `first`, `second`: Equations of all pieces and of each fold's. `pieces`: Pieces of the record. `gain`,
    shape (lines, n_y, n_u): `W H S`. `residual`, shape (lines, n_y, pieces): `R`.
    """

    whole: TermRegression
    first: TermRegression
    second: TermRegression
    pieces: RecordPieces
    gain: NDArray[np.complex128]
    residual: NDArray[np.complex128]

    @classmethod
    def of(cls, pieces: RecordPieces, *, model: FrfModel, weight: NDArray[np.float64]) -> Folds:
        """Form the normal equations with a model's FRF, `W = diag(weight)`."""
        frf = model_at(pieces.frequency, model)
        residual = weight[:, None] * (pieces.response - np.matmul(frf, pieces.drive))
        # A drive that rests in the record gives no information about itself.
        moves = np.any(pieces.drive != 0.0, axis=(0, 2)) & pieces.followers
        gain = np.ascontiguousarray(weight[:, None] * frf * (pieces.scale * moves))
        odd = np.arange(pieces.count) // _GROUP % 2 == 1
        whole, first, second = (
            TermRegression(pieces, used=used, gain=gain, residual=residual) for used in (np.ones_like(odd), ~odd, odd)
        )
        return cls(whole, first, second, pieces, gain, residual)

    def cross_validated(self, chosen: Sequence[Candidate]) -> float:
        """Return the energy left in each fold with the coefficients of the other one, over the energy of both.

        1 without a term, and if there is no energy at all.
        """
        left = self.second.left(chosen, self.first.fit(chosen)) + self.first.left(chosen, self.second.fit(chosen))
        return left / self.whole.energy if self.whole.energy > 0.0 else 1.0

    def covariance(self, chosen: Sequence[Candidate], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the covariance of the coefficients, from the differences between the pieces of the record.

        Source: H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48 (1980); pieces
        that overlap by half count with their neighbours' products (W. Newey, K. West, Econometrica 55, 1987).
        """
        power = powers_of_frequency(self.pieces.frequency)
        columns = [
            np.einsum("mf,fi,fk->mfik", power, self.gain[:, :, drive], self.pieces.product[:, number])
            for drive, number in chosen
        ]
        regressors = np.concatenate(columns)
        missing = self.residual - np.einsum("c,cfik->fik", coefficients, regressors)
        scores = np.einsum("cfik,fik->ck", regressors.conj(), missing).real
        neighbours = scores[:, 1:] @ scores[:, :-1].T
        meat = scores @ scores.T + 0.5 * (neighbours + neighbours.T)
        inverse = np.linalg.inv(self.whole.system(chosen)[0])
        return np.asarray(inverse @ meat @ inverse)


def _rows(common: NDArray[np.float64]) -> NDArray[np.float64]:
    return common.reshape(-1, common.shape[3])
