"""Drive map: forward and backward, exact at every amplitude."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_drive_map.frf_model import FrfModel
from duralab_drive_map.map_terms import (
    MapTerm,
    dependency_order,
    powers_of_frequency,
    product_text,
    unit_of_ratio,
)
from duralab_drive_map.product_band import LARGEST_BAND_SHARE, ProductBand
from duralab_spectra import as_record

# Two frequencies with a smaller relative difference are equal, apart from rounding.
_SAME_FREQUENCY: Final = 1e-9

Adjust = Callable[[int, NDArray[np.float64]], NDArray[np.float64]]
"""Function of a drive's index and its samples that returns other samples: to play, or that the actuator follows."""


@dataclass(frozen=True)
class DriveMap:
    """Change of drive coordinates `v_a = u_a + s_a Σ_j K_aj ∗ π_j(u)` after which a rig is nearly linear, `y ≈ H ∗ v`.

    `π_j` is a product of two drives in units of `scale`, see `MapTerm` for `K`. `K` acts from 0 Hz to
    `highest_frequency` and fades to 0 in the tenth above it. No drive follows itself, so `T⁻¹` is explicit.

    A wheel on arms moves on an arc: the lateral stroke follows the square of the vertical one. A rig whose actuators
    hold the wheel off this arc answers with forces that no linear update can predict.

    Parameters
    ----------
    names, units : tuple of str
        Name and unit of each drive.
    scale : tuple of float
        `s`: RMS of each drive in the record that the map is learned from, drive units, greater than 0.
    terms : tuple of MapTerm
        Terms of the map; empty for the identity.
    sample_rate : float
        Sample rate of the drives, Hz.
    highest_frequency : float
        Upper end of the identified band, Hz; above 0 and at most 0.45 of the sample rate, so that the fade has room.
    moved : callable, optional
        Called with each drive of a product, which is then formed from the returned samples: the motion of an actuator
        that does not follow its drive. It is not part of a stored map.

    Raises
    ------
    ValueError
        Numbers of names, units and scales differ, a scale or a frequency is out of range, a term names a drive that
        does not exist or occurs twice, or the terms close a cycle.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: tuple[float, ...]
    terms: tuple[MapTerm, ...]
    sample_rate: float
    highest_frequency: float
    moved: Adjust | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        count = len(self.names)
        if not count == len(self.units) == len(self.scale):
            raise ValueError(
                f"The drive map has {count} names, {len(self.units)} units and {len(self.scale)} scales; it needs one "
                "of each for each drive."
            )
        for name, scale in zip(self.names, self.scale, strict=True):
            if not (np.isfinite(scale) and scale > 0.0):
                raise ValueError(f"The scale of {name} in the drive map is {scale}; it must be finite and above 0.")
        if not 0.0 < self.highest_frequency <= LARGEST_BAND_SHARE * self.sample_rate < np.inf:
            raise ValueError(
                f"The drive map ends at {self.highest_frequency:g} Hz; it must end above 0 and at most at "
                f"{LARGEST_BAND_SHARE:g} of the sample rate, {LARGEST_BAND_SHARE * self.sample_rate:g} Hz."
            )
        seen = set[tuple[int, tuple[int, int]]]()
        for term in self.terms:
            if max(term.follower, *term.product) >= count:
                raise ValueError(
                    f"A term of the drive map joins the drives {term.product} and {term.follower}; there are {count}, "
                    "counted from 0."
                )
            if (term.follower, term.product) in seen:
                raise ValueError(f"The drive map has the term ({self._text(term)}) twice; state it once.")
            seen.add((term.follower, term.product))
        if dependency_order(self.terms, drives=count) is None:
            raise ValueError(
                f"The terms of the drive map close a cycle ({'; '.join(self.describe())}); no drive may follow itself, "
                "directly or through others: leave a term out."
            )

    @property
    def is_identity(self) -> bool:
        """Whether there is no term, so that drives are not changed."""
        return not self.terms

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Drives in topological order: each comes after those that it follows."""
        order = dependency_order(self.terms, drives=len(self.names))
        if order is None:
            raise AssertionError("The terms were checked to close no cycle.")
        return order

    def to_mapped(self, drive: ArrayLike) -> NDArray[np.float64]:
        """Return the mapped drive `v = T(u)`.

        Parameters
        ----------
        drive : array_like, shape (n_u, samples)
            Drive `u`, drive units.

        Returns
        -------
        ndarray, shape (n_u, samples)
            Mapped drive `v`, drive units; the drive itself if there is no term.

        Raises
        ------
        ValueError
            If the drive does not have the map's channels, or a value is not finite.
        """
        given = self._record(drive)
        if self.is_identity:
            return given
        products = self._band(given.shape[1])
        lowered = {i: self._lowered(i, given[i], products) for i in self._leaders}
        result = given.copy()
        for i in self._followers:
            result[i] += self._followed(i, lowered, products)
        return result

    def to_drive(self, mapped: ArrayLike, *, adjust: Adjust | None = None) -> NDArray[np.float64]:
        """Return the drive `u = T⁻¹(v)`.

        Parameters
        ----------
        mapped : array_like, shape (n_u, samples)
            Mapped drive `v`, drive units.
        adjust : callable, optional
            Called with each drive in topological order, before the drives that follow it are computed, for example to
            limit it. Drives that follow it then follow the returned samples.

        Returns
        -------
        ndarray, shape (n_u, samples)
            Drive `u`, drive units; the mapped drive itself if there is no term and no `adjust`.

        Raises
        ------
        ValueError
            If the drive does not have the map's channels, or a value is not finite.
        """
        given = self._record(mapped)
        if self.is_identity and adjust is None:
            return given
        band = self._band(given.shape[1])
        lowered: dict[int, NDArray[np.float64]] = {}
        result = given.copy()
        for i in self.order:
            if i in self._followers:
                result[i] -= self._followed(i, lowered, band)
            if adjust is not None:
                result[i] = adjust(i, result[i].copy())
            if i in self._leaders:
                lowered[i] = self._lowered(i, result[i], band)
        return result

    def describe(self) -> tuple[str, ...]:
        """Return one sentence part for each term, such as "lateral follows −1.71 /m × vertical²"; its value at 0 Hz.

        Returns
        -------
        tuple of str
            Sentence parts in the order of the terms.
        """
        return tuple(self._text(term) for term in self.terms)

    def static_coefficient(self, term: MapTerm) -> float:
        """Return the coefficient with which a drive follows a product at 0 Hz.

        Parameters
        ----------
        term : MapTerm
            Term of this map.

        Returns
        -------
        float
            Coefficient in the unit of the follower over both units of the product.
        """
        first, second = term.product
        return -term.coefficients[0] * self.scale[term.follower] / (self.scale[first] * self.scale[second])

    def require_drives(self, names: tuple[str, ...], units: tuple[str, ...], *, sample_rate: float) -> None:
        """Refuse a rig whose drives are not those of the map.

        Parameters
        ----------
        names, units : tuple of str
            Names and units of the rig's drives.
        sample_rate : float
            Sample rate of the rig, Hz.

        Raises
        ------
        ValueError
            If names, units or the sample rate differ.
        """
        if names != self.names:
            raise ValueError(
                f"The drive map is for the drives {', '.join(self.names)} and the rig has {', '.join(names)}; a map "
                "holds for the rig that it is learned on: learn it again."
            )
        for name, own, other in zip(names, self.units, units, strict=True):
            if own != other:
                raise ValueError(
                    f"The drive map has {name} in {own} and the rig has it in {other}; learn the map again in the "
                    "rig's units."
                )
        if not math.isclose(sample_rate, self.sample_rate, rel_tol=_SAME_FREQUENCY):
            raise ValueError(
                f"The drive map is for drives of {self.sample_rate:g} Hz and the rig plays {sample_rate:g} Hz; learn "
                "it again at the rig's sample rate."
            )

    def require_model(self, model: FrfModel) -> None:
        """Refuse a model that does not fit the map.

        Parameters
        ----------
        model : FrfModel
            Model from mapped drives to responses.

        Raises
        ------
        ValueError
            If its number of drives or its sample rate differs, or the map acts above its identified band.
        """
        if model.frf.shape[2] != len(self.names):
            raise ValueError(
                f"The drive map has {len(self.names)} drives and the model {model.frf.shape[2]}; take the map and the "
                "model of one rig."
            )
        sample_rate, highest = 2.0 * float(model.frequency[-1]), float(model.frequency[model.identified][-1])
        if not math.isclose(sample_rate, self.sample_rate, rel_tol=_SAME_FREQUENCY):
            raise ValueError(
                f"The drive map is for drives of {self.sample_rate:g} Hz and the model for those of {sample_rate:g} "
                "Hz; take both of one sample rate."
            )
        # The requested end of the band is less than one line above the last identified one.
        if self.highest_frequency > highest + float(model.frequency[1]):
            raise ValueError(
                f"The drive map acts up to {self.highest_frequency:g} Hz and the model is identified up to "
                f"{highest:g} Hz; learn the map of the same identification as the model."
            )

    @cached_property
    def _leaders(self) -> tuple[int, ...]:
        return tuple(sorted({drive for term in self.terms for drive in term.product}))

    @cached_property
    def _followers(self) -> tuple[int, ...]:
        return tuple(sorted({term.follower for term in self.terms}))

    def _record(self, drive: ArrayLike) -> NDArray[np.float64]:
        record = as_record(drive, name="drive")
        if record.shape[0] != len(self.names):
            raise ValueError(f"The drive has {record.shape[0]} channels; the drive map has {len(self.names)} drives.")
        return record

    def _band(self, samples: int) -> ProductBand:
        return ProductBand(samples, sample_rate=self.sample_rate, highest=self.highest_frequency)

    def _lowered(self, leader: int, samples: NDArray[np.float64], band: ProductBand) -> NDArray[np.float64]:
        return band.lowered(samples if self.moved is None else self.moved(leader, samples))

    def _followed(
        self, follower: int, lowered: Mapping[int, NDArray[np.float64]], band: ProductBand
    ) -> NDArray[np.float64]:
        """Return `s_a Σ_j K_aj ∗ π_j(u)` of one drive."""
        powers = powers_of_frequency(band.frequency)
        lines = np.zeros(band.frequency.size, dtype=np.complex128)
        for term in self.terms:
            if term.follower == follower:
                first, second = term.product
                product = (lowered[first] / self.scale[first]) * (lowered[second] / self.scale[second])
                lines += (np.asarray(term.coefficients) @ powers) * band.lines(product)
        return self.scale[follower] * band.samples(lines)

    def _text(self, term: MapTerm) -> str:
        first, second = term.product
        unit = unit_of_ratio(self.units[term.follower], over=(self.units[first], self.units[second]))
        coefficient = self.static_coefficient(term)
        value = f"{'−' if coefficient < 0.0 else ''}{abs(coefficient):.3g}"
        product = product_text(self.names[first], self.names[second])
        return f"{self.names[term.follower]} follows {value} {unit} × {product}"
