"""The whole car: its SDF is what its numbers say; it stands level, feels its road axle by axle, heaves and pitches."""

import numpy as np
import pytest
from full_vehicle import WHEELBASE, VehicleBody, write_sdf

from rig_sim import load_rig, shipped_specimens
from rig_sim.checks.proof import LARGEST_ERROR

PATH = shipped_specimens()["full_vehicle"]
RATE, SPEED = 1000.0, 15.0


@pytest.fixture(scope="module")
def vehicle():
    return load_rig(PATH)


def over_a_bump(rig, *, axles):
    """Return all outputs while the named axles roll over a bump of 20 mm in 1 m, both sides at once."""
    names = rig.model.input_names
    time = np.arange(1500) / RATE
    drive = np.zeros((len(names), len(time)))
    for index, name in enumerate(names):
        behind = WHEELBASE if name.startswith("rear_") else 0.0
        way = np.clip(SPEED * (time - 0.1) - behind, 0.0, 1.0)
        on = ("rear" if behind else "front") in axles
        if name.endswith("speed"):
            drive[index] = SPEED
        elif name.endswith("height"):
            drive[index] = on * 0.01 * (1 - np.cos(2 * np.pi * way))
        elif name.endswith("slope"):
            drive[index] = on * 0.02 * np.pi * np.sin(2 * np.pi * way)
    ahead = np.hstack([drive, drive[:, -1:]])
    specimen = rig.specimen
    played = rig.compiled.play(
        rig.rest, ahead, sample_interval=1 / RATE, substeps=specimen.substeps, method=specimen.integrator
    )
    return played.outputs[:12] - rig.static_response[:, None]


def test_the_shipped_sdf_is_what_the_numbers_say():
    assert PATH.with_suffix(".sdf").read_text() == write_sdf(VehicleBody())


def test_drake_agrees(vehicle):
    assert vehicle.proof.acceleration_error < LARGEST_ERROR
    assert vehicle.proof.force_error < LARGEST_ERROR
    assert vehicle.proof.states >= 20


def test_it_has_sixteen_drives_and_the_front_axle_s_forces_by_the_names_of_an_axle_rig(vehicle, predecessor):
    front, rear = vehicle.model.input_names[:8], vehicle.model.input_names[8:]
    assert front == predecessor.model.input_names
    assert rear == tuple(f"rear_{name}" for name in front)
    assert vehicle.model.response_names[:6] == predecessor.model.response_names
    assert len(vehicle.model.response_names) == 12


def test_it_stands_level_and_its_spindles_carry_all_but_the_wheels(vehicle):
    tree, force = vehicle.model.assembly.tree, vehicle.static_response
    wheels = sum(body.mass for body in tree.bodies if body.name.endswith("wheel"))
    weight = 9.81 * (sum(body.mass for body in tree.bodies) - wheels)
    assert force[[0, 3, 6, 9]].sum() == pytest.approx(weight, rel=1e-4)
    assert force[0] > force[6]
    # Left and right are mirror images: forces across have the other sign.
    np.testing.assert_allclose(force[[0, 1, 2, 6, 7, 8]] * [1, -1, 1, 1, -1, 1], force[[3, 4, 5, 9, 10, 11]], atol=1e-6)
    rest = dict(zip(vehicle.model.state_names, vehicle.rest, strict=True))
    assert abs(rest["body_pitch position 0"]) < np.deg2rad(0.2)
    assert abs(rest["body_roll position 0"]) < 1e-9
    assert abs(rest["body_heave position 0"]) < 0.005


def test_each_axle_feels_its_own_bump_and_the_body_carries_it_to_the_other(vehicle):
    both, front = over_a_bump(vehicle, axles={"front", "rear"}), over_a_bump(vehicle, axles={"front"})
    reached = [int(np.argmax(np.abs(both[row]) > 200.0)) / RATE for row in (0, 6)]
    assert reached[1] - reached[0] == pytest.approx(WHEELBASE / SPEED, abs=0.01)
    np.testing.assert_allclose(both[[0, 1, 2]] * [[1], [-1], [1]], both[[3, 4, 5]], atol=1.0)
    # Without a bump of its own the rear is moved by the body alone: slowly and less.
    assert 5.0 < np.abs(front[6]).max() < 0.25 * np.abs(both[6]).max()
    # Afterwards it comes to rest again.
    assert np.abs(both[0, -50:]).max() < 0.2 * np.abs(both[0]).max()


def test_body_heaves_and_pitches_between_1_and_2_hz_and_wheels_hop_above_9(vehicle):
    names = vehicle.model.input_names
    about = np.array([SPEED if name.endswith("speed") else 0.0 for name in names])
    steps = 1e-6 * np.eye(len(vehicle.rest))
    jacobian = np.array(
        [
            (
                vehicle.compiled.derivative(vehicle.rest + e, about)
                - vehicle.compiled.derivative(vehicle.rest - e, about)
            )
            / 2e-6
            for e in steps
        ]
    ).T
    values = np.linalg.eigvals(jacobian)
    frequency = np.sort(np.abs(values[values.imag > 1e-3])) / (2 * np.pi)
    ride = frequency[(frequency > 0.5) & (frequency < 9.0)]
    assert len(ride) == 3
    assert np.all((ride > 1.0) & (ride < 2.2))
    assert np.count_nonzero((frequency > 9.0) & (frequency < 15.0)) >= 4
