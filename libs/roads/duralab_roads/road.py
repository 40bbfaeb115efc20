"""Road as a grid of elevations, and functions to level and to lengthen it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Road:
    """Elevations of a road over a regular longitudinal and a free lateral grid.

    Between grid points the surface is bilinear, as in OpenCRG. A NaN is a point that was not measured.

    Parameters
    ----------
    spacing
        Longitudinal distance between rows [m], above 0.
    lateral_positions
        Positions v of the columns [m], shape (n_v,), strictly ascending, positive to the left of the reference line.
    elevation
        Heights z [m], shape (n_u, n_v), n_u >= 2; row 0 is where the vehicle starts. Finite or NaN.

    Raises
    ------
    ValueError
        If a shape, the order of the positions or a value is not as above.
    """

    spacing: float
    lateral_positions: NDArray[np.float64]
    elevation: NDArray[np.float64]

    def __post_init__(self) -> None:
        positions = np.array(self.lateral_positions, dtype=np.float64)
        elevation = np.array(self.elevation, dtype=np.float64, order="C")
        if not (math.isfinite(self.spacing) and self.spacing > 0):
            raise ValueError(f"spacing is {self.spacing} m; a road needs a finite spacing above 0 m.")
        if positions.ndim != 1 or positions.size == 0 or not np.all(np.isfinite(positions)):
            raise ValueError(
                f"lateral_positions has shape {positions.shape}; give at least one finite position in one dimension."
            )
        if np.any(np.diff(positions) <= 0):
            raise ValueError("lateral_positions do not ascend; sort the columns from right (negative) to left.")
        if elevation.ndim != 2 or elevation.shape[0] < 2 or elevation.shape[1] != positions.size:
            raise ValueError(
                f"elevation has shape {elevation.shape}; {positions.size} lateral positions need "
                f"(n_u >= 2, {positions.size})."
            )
        if np.any(np.isinf(elevation)):
            raise ValueError("elevation holds an infinite value; give metres, or NaN where nothing was measured.")
        positions.setflags(write=False)
        elevation.setflags(write=False)
        object.__setattr__(self, "spacing", float(self.spacing))
        object.__setattr__(self, "lateral_positions", positions)
        object.__setattr__(self, "elevation", elevation)

    @property
    def length(self) -> float:
        """Distance from the first to the last row [m]."""
        return self.spacing * (self.elevation.shape[0] - 1)


def level(road: Road) -> Road:
    """Subtract the least-squares plane, so that a measured road has no absolute height, grade or bank.

    A rig has no room for a hill: the plane is the site, the rest is the surface. Call this before `repeat_mirrored`,
    which would turn a grade into a zigzag.

    Parameters
    ----------
    road
        Road with at least one measured point; NaN cells are left out of the fit and stay NaN.

    Returns
    -------
    Road
        Same grid around zero height.

    Raises
    ------
    ValueError
        If the road has no measured point.
    """
    rows, columns = np.nonzero(np.isfinite(road.elevation))
    if rows.size == 0:
        raise ValueError("The road has no measured point; a plane needs at least one finite elevation.")
    along = road.spacing * np.arange(road.elevation.shape[0])
    design = np.column_stack([np.ones(rows.size), along[rows], road.lateral_positions[columns]])
    height, grade, bank = np.linalg.lstsq(design, road.elevation[rows, columns], rcond=None)[0]
    plane = height + grade * along[:, None] + bank * road.lateral_positions[None, :]
    return Road(road.spacing, road.lateral_positions, road.elevation - plane)


def repeat_mirrored(road: Road, length_m: float) -> Road:
    """Lengthen a road by mirrored copies: every other copy is mirrored, so that no seam has a step.

    The slope changes its sign at a seam, as it does at any peak of the road. `level` a measured road first.

    Parameters
    ----------
    road
        Road to repeat.
    length_m
        Length of the result [m], above 0; shorter than the road cuts it.

    Returns
    -------
    Road
        Road with the smallest whole number of rows that reaches `length_m`.

    Raises
    ------
    ValueError
        If the length is not finite and above 0.
    """
    if not (math.isfinite(length_m) and length_m > 0):
        raise ValueError(f"length_m is {length_m}; give a finite length above 0 m.")
    rows = road.elevation.shape[0]
    wanted = max(math.ceil(round(length_m / road.spacing, 6)) + 1, 2)
    phase = np.arange(wanted) % (2 * (rows - 1))
    return Road(road.spacing, road.lateral_positions, road.elevation[np.minimum(phase, 2 * (rows - 1) - phase)])
