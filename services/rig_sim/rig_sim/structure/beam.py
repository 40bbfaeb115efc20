"""One straight beam element in space: stiffness and mass of its two ends, in world axes.

Euler–Bernoulli bending in both planes, St. Venant torsion, extension; consistent masses. The beams of a structure are
at least twenty times as long as they are thick, so shear deformation is left out.

Source: J.S. Przemieniecki, Theory of Matrix Structural Analysis, McGraw-Hill 1968, sections 5.6 and 11.3.
"""

from __future__ import annotations

import numpy as np
from pydantic.dataclasses import dataclass as parameters

from rig_sim.parameters import STRICT, Positive


@parameters(config=STRICT)
class Section:
    """A solid rectangle of one material: moduli in Pa, density in kg/m^3, sides in m."""

    youngs_modulus: Positive
    shear_modulus: Positive
    density: Positive
    #: Sides along and across the beam's width axis.
    width: Positive
    thickness: Positive

    @property
    def area(self) -> float:
        """Area in m^2."""
        return self.width * self.thickness

    @property
    def flapwise(self) -> float:
        """Second moment of area for bending along the thickness, in m^4."""
        return self.width * self.thickness**3 / 12.0

    @property
    def edgewise(self) -> float:
        """Second moment of area for bending along the width, in m^4."""
        return self.thickness * self.width**3 / 12.0

    @property
    def torsion(self) -> float:
        """Torsion constant in m^4; Roark's polynomial for a rectangle, within 0.5 % of the series."""
        long, short = max(self.width, self.thickness), min(self.width, self.thickness)
        ratio = short / long
        return long * short**3 * (1.0 / 3.0 - 0.21 * ratio * (1.0 - ratio**4 / 12.0))


def element_matrices(
    section: Section, start: np.ndarray, end: np.ndarray, width_axis: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness and mass of an element."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    across = width_axis - along * float(width_axis @ along)
    across /= np.linalg.norm(across)
    axes = np.array([along, across, np.cross(along, across)])
    turn = np.kron(np.eye(4), axes)
    stiffness, mass = np.zeros((12, 12)), np.zeros((12, 12))
    line_mass = section.density * section.area
    polar = section.density * (section.flapwise + section.edgewise)
    for first, (stiff, heavy) in (
        (0, (section.youngs_modulus * section.area, line_mass)),
        (3, (section.shear_modulus * section.torsion, polar)),
    ):
        rows = np.ix_([first, first + 6], [first, first + 6])
        stiffness[rows] += stiff / length * np.array([[1.0, -1.0], [-1.0, 1.0]])
        mass[rows] += heavy * length / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    # Bending along the width turns about the third axis, bending along the thickness about minus the second.
    for freedoms, sign, area_moment in (
        ([1, 5, 7, 11], 1.0, section.edgewise),
        ([2, 4, 8, 10], -1.0, section.flapwise),
    ):
        bending, inertia = _bending(length, sign)
        rows = np.ix_(freedoms, freedoms)
        stiffness[rows] += section.youngs_modulus * area_moment * bending
        mass[rows] += line_mass * inertia
    return turn.T @ stiffness @ turn, turn.T @ mass @ turn


def _bending(length: float, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness over EI and mass over mass per length, for deflection and rotation of both ends."""
    n = length * sign
    stiffness = np.array(
        [
            [12.0, 6.0 * n, -12.0, 6.0 * n],
            [6.0 * n, 4.0 * n * n, -6.0 * n, 2.0 * n * n],
            [-12.0, -6.0 * n, 12.0, -6.0 * n],
            [6.0 * n, 2.0 * n * n, -6.0 * n, 4.0 * n * n],
        ]
    )
    mass = np.array(
        [
            [156.0, 22.0 * n, 54.0, -13.0 * n],
            [22.0 * n, 4.0 * n * n, 13.0 * n, -3.0 * n * n],
            [54.0, 13.0 * n, 156.0, -22.0 * n],
            [-13.0 * n, -3.0 * n * n, -22.0 * n, 4.0 * n * n],
        ]
    )
    return stiffness / length**3, mass * length / 420.0
