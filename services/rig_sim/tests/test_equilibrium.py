"""At rest: nothing moves, left mirrors right, and the wheels carry the weight."""

import numpy as np
import pytest

from rig_sim.checks.equilibrium import NoEquilibriumError, find_equilibrium
from rig_sim.compile.model import compile_model
from rig_sim.model.assembly import assemble
from rig_sim.model.rig_model import RigModel
from rig_sim.multibody.kinematics import move

MIRRORED = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
"""Signs of vertical, lateral, longitudinal left and right, seen in a mirror at y = 0."""
SWAPPED = [3, 4, 5, 0, 1, 2]


def played(rig, drive, seed=1):
    playback = rig.playback(drive, seed=seed)
    for _ in playback.blocks():
        pass
    return playback.response


def test_spindle_forces_stay_static_under_a_zero_drive(quiet_rig):
    response = played(quiet_rig, np.zeros((len(quiet_rig.specimen.drives), 5000)))
    np.testing.assert_allclose(response, np.repeat(quiet_rig.static_response[:, None], 5000, axis=1), rtol=0, atol=1e-3)


def test_nothing_moves_at_rest(quiet_rig):
    rates = quiet_rig.compiled.derivative(quiet_rig.rest, np.zeros(len(quiet_rig.specimen.drives)))
    assert np.abs(rates).max() < 1e-6


def test_static_forces_of_left_and_right_are_mirror_images(quiet_rig):
    static = quiet_rig.static_response
    np.testing.assert_allclose(static[SWAPPED], MIRRORED * static, rtol=1e-6, atol=1e-3)


def test_mirrored_drives_have_mirrored_responses(quiet_rig):
    time = np.arange(1500) / 1000.0
    drive = np.array(
        [0.012 * np.sin(2 * np.pi * f * time + p) for f, p in ((3, 0), (5, 1), (7, 2), (4, 0), (6, 3), (2, 1))]
    )
    drive *= (1 - np.cos(2 * np.pi * time / 1.5)) / 2
    # Drives of the road: height, slope and camber; of the actuators: vertical, lateral, longitudinal.
    on_road = quiet_rig.specimen.name == "predecessor"
    signs = np.array([1, 1, -1, 1, 1, -1]) if on_road else MIRRORED
    mirror = (signs[:, None] * drive)[SWAPPED]
    if on_road:
        drive, mirror = (np.insert(some, [3, 6], 15.0, axis=0) for some in (drive, mirror))
    response = played(quiet_rig, drive)
    mirrored = played(quiet_rig, mirror)
    scale = np.ptp(response, axis=1).max()
    # Mirrored sums round differently, and so do the numbers of the SDF.
    np.testing.assert_allclose(mirrored, MIRRORED[:, None] * response[SWAPPED], rtol=0, atol=1e-5 * scale)


def test_the_predecessors_tyres_carry_its_weight(quiet_predecessor):
    tree = quiet_predecessor.model.assembly.tree
    masses = {body.name: body.mass for body in tree.bodies}
    above = sum(masses.values()) - masses["left_wheel"] - masses["right_wheel"]
    vertical = quiet_predecessor.static_response[[0, 3]].sum()
    # The spindle is between tyre and axle; in its own axes, which lean with the wheel by a fraction of a degree.
    motion = move(tree, quiet_predecessor.rest[: len(tree.default_positions)], np.zeros(tree.velocity_count))
    poses = [motion.poses[tree.body_index(f"{side}_wheel")] for side in ("left", "right")]
    forces = quiet_predecessor.static_response.reshape(2, 3)[:, [2, 1, 0]]
    upward = sum((pose.rotation @ force)[2] for pose, force in zip(poses, forces, strict=True))
    assert upward == pytest.approx(above * 9.81, rel=1e-9)
    assert vertical == pytest.approx(upward, rel=2e-3)


def test_the_body_held_axle_stands_on_its_vertical_actuators(quiet_front_axle):
    # The pistons' pressures bear the pistons themselves too: pressure force = spindle force + wheel and piston weight.
    rig = quiet_front_axle
    for side, channel in (("left", 0), ("right", 3)):
        actuator = next(element for element in rig.model.assembly.elements if element.name == f"{side}_vertical")
        state = rig.rest[rig.model.element_slice(actuator.name)]
        force = actuator.cylinder.area * 1e6 * (state[2] - state[3])
        masses = {body.name: body.mass for body in rig.model.assembly.tree.bodies}
        weight = 9.81 * (masses[f"{side}_wheel"] + masses[f"{side}_vertical_piston"])
        # Lateral and longitudinal rods are level but for the tilt of a stroke at rest: nearly no vertical part.
        assert force == pytest.approx(rig.static_response[channel] + weight, rel=5e-3)


def test_other_drives_have_a_rest_of_their_own(quiet_front_axle):
    rig = quiet_front_axle
    drive = np.array([0.02, 0.0, 0.0, -0.02, 0.0, 0.0])
    state = find_equilibrium(rig.model, rig.compiled.derivative, drive)
    stroke = dict(zip(rig.model.state_names, state, strict=True))
    # The integral takes the error away.
    assert stroke["left_vertical_stroke position 0"] == pytest.approx(0.02, abs=1e-9)
    assert stroke["right_vertical_stroke position 0"] == pytest.approx(-0.02, abs=1e-9)
    forces = rig.compiled.outputs(state, drive)[:6]
    assert forces[0] > rig.static_response[0] + 500.0 > rig.static_response[3] > forces[3] + 500.0


def test_a_rig_that_hangs_on_nothing_is_refused(quiet_predecessor):
    tree = quiet_predecessor.model.assembly.tree
    # Without struts the body falls on its axle.
    assembly = assemble(quiet_predecessor.specimen.model_copy(update={"struts": (), "tyres": (), "drives": ()}), tree)
    model = RigModel(assembly)
    compiled = compile_model(model.traced, state_names=model.state_names, input_names=())
    with pytest.raises(NoEquilibriumError, match=r"the rig finds no rest: '.* velocity \d' still changes by "):
        find_equilibrium(model, compiled.derivative, np.zeros(0))


def test_a_model_that_is_not_finite_is_refused_with_a_sentence(quiet_predecessor):
    model = quiet_predecessor.model

    def broken(state, inputs):
        rates = quiet_predecessor.compiled.derivative(state, inputs)
        rates[model.position_count + 3] = np.nan
        return rates

    with pytest.raises(NoEquilibriumError, match="still changes by nan per second"):
        find_equilibrium(model, broken, np.zeros(len(model.input_names)))
