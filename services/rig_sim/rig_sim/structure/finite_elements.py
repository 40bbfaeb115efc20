"""From beams to modes: assemble a structure's finite elements and solve for what its channels see of each mode."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rig_sim.structure.beam import element_matrices
from rig_sim.structure.modal_model import ModalModel
from rig_sim.structure.specimen import StructureSpecimen


def find_modes(specimen: StructureSpecimen) -> ModalModel:
    """Return the modes of a structure up to its highest one."""
    # Imported here: a multibody rig, which has no modes, shall not wait for scipy at its start.
    from scipy.linalg import eigh

    stiffness, mass, first = _assemble(specimen)
    # Both are NumPy arrays; the stubs of scipy say less.
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
