"""Random roads with the displacement spectrum of ISO 8608 and an isotropic surface between the wheel tracks."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import k1

from duralab_roads.road import Road

REFERENCE_WAVENUMBER = 0.1
"""n0 of ISO 8608 [cycles/m]."""

MAXIMUM_CELLS = 50_000_000
"""Largest number of cells of a synthesised grid (0.4 GB); repeat a road for a longer one."""

TRACK_COLUMNS = (-0.95, -0.85, -0.75, -0.65, -0.55, 0.55, 0.65, 0.75, 0.85, 0.95)
"""Default columns [m]: five under each wheel of a 1.5 m track, wide enough for a 0.4 m patch."""


class RoadClass(Enum):
    """Roughness classes of ISO 8608: geometric mean of G_d(n0) [m³]."""

    A = 16e-6
    B = 64e-6
    C = 256e-6
    D = 1024e-6
    E = 4096e-6


def roughness_coefficient(road_class: RoadClass | str | float) -> float:
    """Return G_d(n0), the displacement spectral density at 0.1 cycles/m.

    Parameters
    ----------
    road_class
        A class, its letter, two letters "C/D" for the geometric mean between them, or G_d(n0) itself [m³], above 0.

    Returns
    -------
    float
        G_d(n0) [m³].

    Raises
    ------
    ValueError
        If the class is unknown, or the number is not finite and above 0.

    Source: ISO 8608:2016, Table C.2 (geometric means, n0 = 0.1 cycles/m).
    """
    if isinstance(road_class, RoadClass):
        return road_class.value
    if isinstance(road_class, str):
        letters = road_class.strip().upper().split("/")
        if not 1 <= len(letters) <= 2 or any(letter not in RoadClass.__members__ for letter in letters):
            raise ValueError(f"Road class {road_class!r} is unknown; take one of A, B, C, D, E or a pair such as C/D.")
        return math.prod(RoadClass[letter].value for letter in letters) ** (1 / len(letters))
    if not (math.isfinite(road_class) and road_class > 0):
        raise ValueError(f"G_d(n0) is {road_class} m³; give a finite value above 0, class C has 256e-6.")
    return float(road_class)


def track_coherence(wavenumber: ArrayLike, distance: ArrayLike) -> NDArray[np.float64]:
    """Return the coherence between two parallel tracks on an isotropic surface.

    With G_d ~ n^-2 along any line, isotropy gives S_lr(n)/S_ll(n) = z K_1(z), z = 2 pi n distance: 1 for long waves,
    0 for short ones. It is real (no side leads), and consistent for any number of tracks because it is the coherence of
    a surface. K_1 is the modified Bessel function.

    Parameters
    ----------
    wavenumber
        Wavenumber n [cycles/m], at least 0, any shape that broadcasts with that of `distance`.
    distance
        Lateral distance of the tracks [m], at least 0, any shape.

    Returns
    -------
    ndarray
        Amplitude coherence in [0, 1], of their common shape; its square is the estimate of `scipy.signal.coherence`.

    Source: Dodds & Robson, The description of road surface roughness, J. Sound Vib. 31 (1973) 175-183; Kamash &
    Robson, The application of isotropy in road surface modelling, J. Sound Vib. 57 (1978) 89-100.
    """
    z = np.asarray(2 * np.pi * np.asarray(wavenumber, float) * np.asarray(distance, float))
    nonzero = np.where(z > 0, z, 1.0)
    return np.where(z > 0, nonzero * k1(nonzero), 1.0)


def iso8608_road(
    *,
    road_class: RoadClass | str | float,
    length_m: float,
    seed: int,
    spacing_m: float = 0.025,
    lateral_positions: ArrayLike = TRACK_COLUMNS,
    shortest_wavelength_m: float = 0.2,
    longest_wavelength_m: float = 50.0,
) -> Road:
    """Synthesise a Gaussian road: G_d(n) = G_d(n0) (n/n0)^-2 in every track, isotropic coherence between them.

    Each line of the spectrum is complex white noise through the Cholesky factor of the tracks' coherence matrix.
    Outside the wavelength band the road is flat, so a track's variance is G_d(n0) n0² (l_max - l_min).

    Parameters
    ----------
    road_class
        Class of the road, see `roughness_coefficient`.
    length_m
        Length [m], at least `longest_wavelength_m`.
    seed
        Seed of the generator, at least 0. Same arguments, same bytes.
    spacing_m
        Longitudinal spacing [m], at most half the shortest wavelength.
    lateral_positions
        Columns [m], shape (n_v,), strictly ascending, positive left.
    shortest_wavelength_m, longest_wavelength_m
        Band of the road [m]. Shorter waves than 0.2 m barely pass a tyre; longer ones than 50 m are hills.

    Returns
    -------
    Road
        Road with zero expected height, without lead-in (see `effective_inputs`).

    Raises
    ------
    ValueError
        If a length is not finite and above 0, the band is empty or does not fit spacing and length, or the road has too
        many cells.

    Source: ISO 8608:2016, Annex B; Shinozuka & Jan, Digital simulation of random processes and its applications,
    J. Sound Vib. 25 (1972) 111-128.
    """
    coefficient = roughness_coefficient(road_class)
    positions = np.asarray(lateral_positions, dtype=np.float64)
    _check_band(length_m, spacing_m, shortest_wavelength_m, longest_wavelength_m)
    rows = round(length_m / spacing_m) + 1
    if rows * positions.size > MAXIMUM_CELLS:
        raise ValueError(
            f"A road of {rows} rows by {positions.size} columns has more than {MAXIMUM_CELLS} cells; "
            "take a larger spacing_m or lengthen a shorter road with repeat_mirrored."
        )
    # The period is longer than the road, so that its end is not periodic with its start.
    period_rows = rows + math.ceil(longest_wavelength_m / spacing_m)
    resolution = 1 / (period_rows * spacing_m)
    lines = np.arange(
        math.ceil(1 / (longest_wavelength_m * resolution)), math.floor(1 / (shortest_wavelength_m * resolution)) + 1
    )
    wavenumber = np.asarray(lines * resolution, dtype=np.float64)
    density = coefficient * (wavenumber / REFERENCE_WAVENUMBER) ** -2
    noise = np.random.default_rng(seed).standard_normal((2, lines.size, positions.size))
    tracks = _correlate(noise[0] + 1j * noise[1], wavenumber, positions)
    spectrum = np.zeros((period_rows // 2 + 1, positions.size), dtype=np.complex128)
    # E|X|² = G_d dn / 2 for the two-sided lines; the noise has variance 2.
    spectrum[lines] = tracks * np.sqrt(density * resolution / 4)[:, None] * period_rows
    return Road(spacing_m, positions, np.fft.irfft(spectrum, n=period_rows, axis=0)[:rows])


def _correlate(
    noise: NDArray[np.complex128], wavenumber: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Apply the tracks' coherence to white noise (lines, n_v), a few lines at a time to bound the matrices' memory."""
    distance = np.abs(positions[:, None] - positions[None, :])
    tracks = np.empty_like(noise)
    for start in range(0, wavenumber.size, 2048):
        some = slice(start, start + 2048)
        factor = np.linalg.cholesky(track_coherence(wavenumber[some, None, None], distance))
        tracks[some] = (factor @ noise[some, :, None])[..., 0]
    return tracks


def _check_band(length_m: float, spacing_m: float, shortest_m: float, longest_m: float) -> None:
    for name, value in (
        ("length", length_m),
        ("spacing", spacing_m),
        ("shortest wavelength", shortest_m),
        ("longest wavelength", longest_m),
    ):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"The {name} is {value} m; it must be finite and above 0.")
    if shortest_m >= longest_m:
        raise ValueError(f"The shortest wavelength, {shortest_m} m, is not below the longest, {longest_m} m.")
    if spacing_m > shortest_m / 2:
        raise ValueError(
            f"spacing_m is {spacing_m}; waves of {shortest_m} m need at most {shortest_m / 2} m between rows."
        )
    if length_m < longest_m:
        raise ValueError(
            f"length_m is {length_m}, shorter than the longest wavelength of {longest_m} m; "
            "lengthen the road or lower longest_wavelength_m."
        )
