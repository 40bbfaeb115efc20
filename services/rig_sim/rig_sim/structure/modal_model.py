"""Modes of a structure as a state space: force in, acceleration out; sampled exactly, and its FRF in closed form.

Each mode has q'' + 2 ζ ω q' + ω² q = Φ_d u with mass-normalised shapes; a response is Σ Φ_r q''. Between samples the
force is linear, as on every rig of this project, so one matrix exponential per mode is exact: no error of integration,
at any damping.

Source: L. Ljung, System Identification, 2nd ed. 1999, section 2.1 (sampling); C.F. Van Loan, Computing integrals
involving the matrix exponential, IEEE Trans. Automatic Control 23 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig_sim.structure.beam import element_matrices
from rig_sim.structure.specimen import StructureSpecimen

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class SampledModel:
    """x[k+1] = a x[k] + b0 u[k] + b1 u[k+1], y[k] = c x[k] + d u[k]; x has q and q' of each mode in sequence."""

    a: np.ndarray
    b0: np.ndarray
    b1: np.ndarray
    c: np.ndarray
    d: np.ndarray


@dataclass(frozen=True)
class ModalModel:
    """Modes at the channels: natural frequency in Hz, damping ratio, mass-normalised shapes in 1/sqrt(kg)."""

    frequency: np.ndarray
    damping: np.ndarray
    at_drives: np.ndarray
    at_responses: np.ndarray

    def sampled(self, sample_rate: float) -> SampledModel:
        """Return the state space sampled at `sample_rate` in Hz."""
        modes, drives = len(self.frequency), len(self.at_drives)
        a = np.zeros((2 * modes, 2 * modes))
        b0, b1 = np.zeros((2, 2 * modes, drives))
        c = np.zeros((len(self.at_responses), 2 * modes))
        for index, (omega, damping) in enumerate(zip(2.0 * np.pi * self.frequency, self.damping, strict=True)):
            rows = slice(2 * index, 2 * index + 2)
            a[rows, rows], now, following = _sampled_mode(omega, damping, 1.0 / sample_rate)
            b0[rows] = np.outer(now, self.at_drives[:, index])
            b1[rows] = np.outer(following, self.at_drives[:, index])
            c[:, rows] = np.outer(self.at_responses[:, index], [-(omega**2), -2.0 * damping * omega])
        return SampledModel(a, b0, b1, c, self.at_responses @ self.at_drives.T)

    def sampled_frf(self, frequency: np.ndarray, sample_rate: float) -> Complex:
        """Return the FRF in (m/s^2)/N of a player of this model, from drive to response samples, at frequencies in Hz.

        It differs from `continuous_frf` by the shape of the drive between samples.
        """
        z = np.exp(2j * np.pi * np.asarray(frequency) / sample_rate)
        frf = np.zeros((len(z), len(self.at_responses), len(self.at_drives)), dtype=np.complex128)
        frf += self.at_responses @ self.at_drives.T
        for index, (omega, damping) in enumerate(zip(2.0 * np.pi * self.frequency, self.damping, strict=True)):
            a, now, following = _sampled_mode(omega, damping, 1.0 / sample_rate)
            rhs = now[:, None] + following[:, None] * z
            # (z I - a)⁻¹ of a 2 × 2 matrix, written out.
            determinant = (z - a[0, 0]) * (z - a[1, 1]) - a[0, 1] * a[1, 0]
            place = ((z - a[1, 1]) * rhs[0] + a[0, 1] * rhs[1]) / determinant
            speed = (a[1, 0] * rhs[0] + (z - a[0, 0]) * rhs[1]) / determinant
            gain = -(omega**2) * place - 2.0 * damping * omega * speed
            frf += gain[:, None, None] * np.outer(self.at_responses[:, index], self.at_drives[:, index])
        return frf

    def continuous_frf(self, frequency: np.ndarray) -> Complex:
        """Return the FRF of the structure itself in (m/s^2)/N at frequencies in Hz."""
        s = 2j * np.pi * np.asarray(frequency)[:, None]
        omega = 2.0 * np.pi * self.frequency
        gain = s**2 / (s**2 + 2.0 * self.damping * omega * s + omega**2)
        return np.einsum("om,fm,im->foi", self.at_responses, gain, self.at_drives)


def _sampled_mode(omega: float, damping: float, interval: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a (2, 2), b0 (2,), b1 (2,) of a mode of unit mass under a force that is linear over the interval."""
    augmented = np.zeros((4, 4))
    augmented[:2, :2] = [[0.0, interval], [-(omega**2) * interval, -2.0 * damping * omega * interval]]
    augmented[1, 2] = interval
    augmented[2, 3] = 1.0
    # Imported here, so that a multibody rig, which has no modes, does not wait for scipy at its start.
    from scipy.linalg import expm

    solution = np.asarray(expm(augmented))
    hold, rise = solution[:2, 2], solution[:2, 3]
    return solution[:2, :2], hold - rise, rise


def find_modes(specimen: StructureSpecimen) -> ModalModel:
    """Return the modes of a structure up to its highest one."""
    # Imported here, so that a multibody rig, which has no modes, does not wait for scipy at its start.
    from scipy.linalg import eigh

    stiffness, mass, first = _assemble(specimen)
    # Both are NumPy arrays; the stubs of scipy are less specific.
    squares, shapes = eigh(stiffness, mass)
    squares, shapes = np.asarray(squares), np.asarray(shapes)
    frequency = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    if frequency[0] < 1.0e-3:
        raise ValueError(
            f"its slowest mode has {frequency[0]:.1g} Hz: the structure is not held in every direction; "
            "add bungees, or stiffness to them."
        )
    kept = frequency <= specimen.highest_mode
    frequency, shapes = frequency[kept], shapes[:, kept]
    slow = int(np.count_nonzero(frequency < specimen.suspension_below))
    elastic = len(frequency) - slow
    ratios = (
        [specimen.damping.suspension] * slow
        + list(specimen.damping.elastic)[:elastic]
        + [specimen.damping.further] * max(elastic - len(specimen.damping.elastic), 0)
    )

    def seen(places: list[tuple[str, str]]) -> np.ndarray:
        return shapes[[first[point] + "xyz".index(axis) for point, axis in places]]

    return ModalModel(
        frequency=frequency,
        damping=np.array(ratios),
        at_drives=seen([(channel.point, channel.axis) for channel in specimen.drives]),
        at_responses=seen([(channel.point, channel.axis) for channel in specimen.responses]),
    )


def _assemble(specimen: StructureSpecimen) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """Return stiffness and mass (freedoms, freedoms), and each point's first freedom: x of x, y, z and rotations."""
    first: dict[str, int] = {}
    freedoms = 0
    for point in specimen.points:
        if any(point in (beam.start, beam.end) for beam in specimen.beams):
            first[point] = freedoms
            freedoms += 6
    inner = sum(6 * (beam.elements - 1) for beam in specimen.beams)
    stiffness, mass = np.zeros((2, freedoms + inner, freedoms + inner))
    for beam in specimen.beams:
        start, end = np.array(specimen.points[beam.start]), np.array(specimen.points[beam.end])
        width = np.array(beam.width_axis)
        nodes = [first[beam.start], *range(freedoms, freedoms + 6 * (beam.elements - 1), 6), first[beam.end]]
        freedoms += 6 * (beam.elements - 1)
        step = (end - start) / beam.elements
        own_stiffness, own_mass = element_matrices(specimen.sections[beam.section], start, start + step, width)
        for near, far in pairwise(nodes):
            rows = np.ix_(
                [*range(near, near + 6), *range(far, far + 6)], [*range(near, near + 6), *range(far, far + 6)]
            )
            stiffness[rows] += own_stiffness
            mass[rows] += own_mass
    for item in specimen.masses:
        for freedom in range(first[item.point], first[item.point] + 3):
            mass[freedom, freedom] += item.mass
    for bungee in specimen.bungees:
        for axis, value in enumerate(bungee.stiffness):
            stiffness[first[bungee.point] + axis, first[bungee.point] + axis] += value
    return stiffness, mass, first
