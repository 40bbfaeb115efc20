"""Beam elements against the formulas of beam theory."""

import numpy as np
import pytest
from scipy.linalg import eigh

from rig_sim.structure.beam import Section, element_matrices

PLATE = Section(youngs_modulus=7.2e10, shear_modulus=2.7e10, density=2700.0, width=0.1, thickness=0.01)
LENGTH = 1.0


def beam(elements, direction=(1.0, 0.0, 0.0), width_axis=(0.0, 1.0, 0.0)):
    """Return stiffness and mass of a straight beam of LENGTH."""
    freedoms = 6 * (elements + 1)
    stiffness, mass = np.zeros((2, freedoms, freedoms))
    step = LENGTH / elements * np.array(direction)
    own = element_matrices(PLATE, np.zeros(3), step, np.array(width_axis))
    for index in range(elements):
        rows = slice(6 * index, 6 * index + 12)
        stiffness[rows, rows] += own[0]
        mass[rows, rows] += own[1]
    return stiffness, mass


def test_a_cantilever_bends_and_twists_as_in_the_textbook():
    stiffness, _ = beam(3)
    held = stiffness[6:, 6:]
    load = np.zeros((len(held), 4))
    load[-6, 0] = load[-5, 1] = load[-4, 2] = load[-3, 3] = 1.0
    moved = np.linalg.solve(held, load)
    e, g = PLATE.youngs_modulus, PLATE.shear_modulus
    assert moved[-6, 0] == pytest.approx(LENGTH / (e * PLATE.area))
    assert moved[-5, 1] == pytest.approx(LENGTH**3 / (3 * e * PLATE.edgewise))
    assert moved[-4, 2] == pytest.approx(LENGTH**3 / (3 * e * PLATE.flapwise))
    assert moved[-3, 3] == pytest.approx(LENGTH / (g * PLATE.torsion))
    # A lift at the end turns it nose up: about -y where x goes out and z up.
    assert moved[-2, 2] == pytest.approx(-(LENGTH**2) / (2 * e * PLATE.flapwise))


def test_torsion_constant_of_rectangles():
    # Timoshenko's series: 0.3123 b t³ for 10 : 1, 0.1406 for a square.
    assert PLATE.torsion == pytest.approx(0.3123 * 0.1 * 0.01**3, rel=0.005)
    square = Section(youngs_modulus=1.0, shear_modulus=1.0, density=1.0, width=2.0, thickness=2.0)
    assert square.torsion == pytest.approx(0.1406 * 16.0, rel=0.005)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8)])
def test_a_free_beam_has_six_rigid_motions_its_mass_and_the_textbook_s_frequencies(direction):
    across = (0.0, 1.0, 0.0) if direction[0] else (1.0, 0.0, 0.0)
    stiffness, mass = beam(10, direction, across)
    squares = eigh(stiffness, mass, eigvals_only=True)
    assert np.abs(squares[:6]).max() < 1e-4 * squares[6]
    for axis in range(3):
        every = np.zeros(len(mass))
        every[axis::6] = 1.0
        assert every @ mass @ every == pytest.approx(2700.0 * 0.001 * LENGTH)
    # Free-free bending, (β L)² = 22.3733 and 61.6728 (Blevins, Formulas for Natural Frequency, table 8-1).
    root = np.sqrt(PLATE.youngs_modulus * PLATE.flapwise / (2700.0 * PLATE.area)) / LENGTH**2
    np.testing.assert_allclose(np.sqrt(squares[6:8]), np.array([22.3733, 61.6728]) * root, rtol=4e-4)
