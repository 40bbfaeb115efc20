"""The anti-roll bar against geometry, statics and energy; in the front axle, and the steering rack beside it."""

import dataclasses

import numpy as np
import pytest

from rig_sim.checks.equilibrium import find_equilibrium
from rig_sim.compile.model import compile_model
from rig_sim.elements.anti_roll_bar import AntiRollBar, AntiRollBarLaw, Lever
from rig_sim.model.assembly import assemble
from rig_sim.model.rig_model import RigModel
from rig_sim.multibody.forces import Effect, stretch
from rig_sim.multibody.kinematics import Motion, move
from rig_sim.multibody.spatial import ZERO, Spatial, cross, rotation_about, rotation_from_roll_pitch_yaw
from rig_sim.multibody.tree import Pose
from rig_sim.specimen.specimen import SpecimenError

LAW = AntiRollBarLaw(stiffness=1200.0, damping=3.0)
AXIS = np.array([0.0, 1.0, 0.0])
MIRROR = np.diag([1.0, -1.0, 1.0])
BODY, LEFT, RIGHT = 1, 2, 3


def lever(side, body):
    mirror = MIRROR if side == "right" else np.eye(3)
    foot = mirror @ [0.03, 0.56, 0.205]
    return Lever.at_design(
        pivot=mirror @ [0.23, 0.40, 0.29],
        end=mirror @ [0.03, 0.545, 0.33],
        axis=AXIS,
        foot=foot,
        link_body=body,
        local_foot=foot,
    )


BAR = AntiRollBar("bar", BODY, (lever("left", LEFT), lever("right", RIGHT)), LAW)


def small(rng, size):
    return Pose(rotation_from_roll_pitch_yaw(size * rng.normal(size=3)), size * rng.normal(size=3))


def spatial(rng):
    return Spatial(rng.normal(size=3), rng.normal(size=3))


def anyhow(rng):
    """Return the motion of the world, a body anywhere, and two arms within a few centimetres of their place in it."""
    body = small(rng, 1.0)
    poses = [Pose(np.eye(3), np.zeros(3)), body, body @ small(rng, 0.02), body @ small(rng, 0.02)]
    return Motion(poses, [ZERO, spatial(rng), spatial(rng), spatial(rng)], [], [], [], np.zeros(0), np.zeros(0))


def later(motion, seconds):
    poses = []
    for pose, velocity in zip(motion.poses, motion.velocities, strict=True):
        turned = pose.rotation + seconds * np.array([cross(velocity.angular, column) for column in pose.rotation.T]).T
        poses.append(Pose(turned, pose.origin + seconds * velocity.at(pose.origin)))
    return dataclasses.replace(motion, poses=poses)


def applied(motion, bar=BAR):
    effect = Effect([ZERO] * 4, [])
    assert bar.apply(motion, np.zeros(0), np.zeros(0), effect) == []
    return effect


def difference(motion):
    angles = []
    for end in BAR.levers:
        foot = motion.point(end.link_body, end.foot)[0]
        body = motion.poses[BODY]
        angles.append(end.angle_and_gradient(body.rotation.T @ (foot - body.origin))[0])
    return angles[0] - angles[1]


@pytest.mark.parametrize("angle", [-0.5, -0.1, 0.0, 0.3, 0.6])
def test_a_levers_angle_is_the_one_its_link_stands_at(angle):
    left = BAR.levers[0]
    end = left.pivot + rotation_about(AXIS, angle) @ (left.end - left.pivot)
    link = left.foot - left.end
    # The link may lean as it likes, its length stays.
    foot = end + rotation_from_roll_pitch_yaw(np.array([0.1, 0.15, -0.2])) @ link
    found, gradient = left.angle_and_gradient(foot)
    assert found == pytest.approx(angle, abs=1e-12)
    nudges = 1e-6 * np.eye(3)
    slope = [left.angle_and_gradient(foot + n)[0] - left.angle_and_gradient(foot - n)[0] for n in nudges]
    np.testing.assert_allclose(gradient, np.array(slope) / 2e-6, rtol=1e-7)


def test_the_bar_does_nothing_while_both_sides_move_alike():
    rng = np.random.default_rng(3)
    for _ in range(20):
        arm, spin = small(rng, 0.03), spatial(rng)
        other = Pose(MIRROR @ arm.rotation @ MIRROR, MIRROR @ arm.origin)
        # Angular velocity is an axial vector: mirrored, and turned round.
        poses = [Pose(np.eye(3), np.zeros(3))] * 2 + [arm, other]
        spins = [ZERO, ZERO, spin, Spatial(-MIRROR @ spin.angular, MIRROR @ spin.linear)]
        effect = applied(Motion(poses, spins, [], [], [], np.zeros(0), np.zeros(0)))
        assert abs(effect.monitored["bar.moment"]) < 1e-10
        for wrench in effect.wrenches:
            np.testing.assert_allclose([*wrench.angular, *wrench.linear], 0.0, atol=1e-9)


def test_the_bar_gives_back_what_it_stores_and_takes_what_it_damps():
    rng = np.random.default_rng(4)
    for _ in range(30):
        motion = anyhow(rng)
        effect = applied(motion)
        power = sum(v.power(w) for v, w in zip(motion.velocities, effect.wrenches, strict=True))
        rate = (difference(later(motion, 1e-6)) - difference(later(motion, -1e-6))) / 2e-6
        stored = LAW.stiffness * difference(motion) * rate
        assert power == pytest.approx(-stored - LAW.damping * rate**2, rel=1e-5, abs=1e-5)


def test_links_pull_along_themselves_and_levers_are_in_balance():
    rng = np.random.default_rng(5)
    for _ in range(20):
        motion = anyhow(rng)
        effect = applied(motion)
        body, moment = motion.poses[BODY], effect.monitored["bar.moment"]
        total = Spatial(np.zeros(3), np.zeros(3))
        for end, sign in zip(BAR.levers, (-1.0, 1.0), strict=True):
            foot = motion.point(end.link_body, end.foot)[0]
            angle = end.angle_and_gradient(body.rotation.T @ (foot - body.origin))[0]
            tip = body.rotation @ (end.pivot + rotation_about(AXIS, angle) @ (end.end - end.pivot)) + body.origin
            force = effect.wrenches[end.link_body].linear
            np.testing.assert_allclose(np.cross(force, tip - foot), 0.0, atol=1e-8)
            # About the bar's axis, what a link does to its lever (the opposite of its foot's) is held by the torsion.
            pivot = body.rotation @ end.pivot + body.origin
            about_axis = (body.rotation @ AXIS) @ np.cross(tip - pivot, -force)
            assert about_axis == pytest.approx(-sign * moment, rel=1e-9, abs=1e-9)
            total = total + effect.wrenches[end.link_body]
        np.testing.assert_allclose(effect.wrenches[BODY].linear, -total.linear, atol=1e-9)
        np.testing.assert_allclose(effect.wrenches[BODY].angular, -total.angular, atol=1e-9)


def test_in_roll_the_bar_stiffens_the_wheel_as_levers_and_motion_ratio_say(front_axle):
    specimen, tree = front_axle.specimen, front_axle.model.assembly.tree
    travel = 0.005
    drive = np.array([travel, 0.0, 0.0, -travel, 0.0, 0.0])

    def rates(bars):
        model = RigModel(assemble(specimen.model_copy(update={"anti_roll_bars": bars}), tree))
        compiled = compile_model(model.traced, state_names=model.state_names, input_names=model.input_names)
        roll = compiled.outputs(find_equilibrium(model, compiled.derivative, drive), drive)
        heave = compiled.outputs(find_equilibrium(model, compiled.derivative, abs(drive)), abs(drive))
        rest = compiled.outputs(find_equilibrium(model, compiled.derivative, 0 * drive), 0 * drive)
        return (roll[0] - roll[3]) / (2 * travel), (heave[0] - rest[0]) / travel

    (with_bar, heave_with), (without, heave_without) = rates(specimen.anti_roll_bars), rates(())
    part = specimen.anti_roll_bars[0]
    # The lower arm turns about its bushings; its outer ball goes up with the wheel.
    front, rear, ball = (np.array(p) for p in ((0.030, 0.270, 0.196), (-0.280, 0.300, 0.200), (0.008, 0.715, 0.190)))
    hinge = (front - rear) / np.linalg.norm(front - rear)
    rise = [np.cross(hinge, np.array(point) - front)[2] for point in (part.link_point, ball)]
    level = part.pivot[0] - part.lever_end[0]
    expected = 2 * part.law.stiffness * (rise[0] / rise[1] / level) ** 2
    assert 20e3 < expected < 30e3
    assert with_bar - without == pytest.approx(expected, rel=0.1)
    assert heave_with == pytest.approx(heave_without, rel=1e-6)


def test_the_rack_gives_way_to_the_difference_of_its_tie_rods(front_axle_compliant):
    rig, tree = front_axle_compliant, front_axle_compliant.model.assembly.tree
    rack = tree.body_index("rack")
    slide = tree.joint("rack_stroke").position_start
    stiffness = next(bushing for bushing in tree.bushings if bushing.body_c == rack).force_stiffness[1]

    def rest(lateral):
        drive = np.array([0.0, lateral[0], 0.0, 0.0, lateral[1], 0.0])
        return find_equilibrium(rig.model, rig.compiled.derivative, drive)

    assert abs(rest((0.03, -0.03))[slide]) < 1e-9
    state = rest((0.03, 0.03))
    motion = move(tree, state[: rig.model.position_count], np.zeros(tree.velocity_count))
    rods = [spring for spring in tree.springs if spring.body_a == rack]
    assert len(rods) == 2
    pull = 0.0
    for rod in rods:
        _, _, direction, length, _ = stretch(motion, rod.body_a, rod.point_a, rod.body_b, rod.point_b)
        pull += rod.stiffness * (length - rod.free_length) * direction[1]
    assert abs(pull) > 50.0
    assert stiffness * state[slide] == pytest.approx(pull, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"link_point": (-0.100, 0.560, 0.340)}, "its link stands at 7 degrees to its lever"),
        ({"lever_end": (0.230, 0.545, 0.290)}, "its lever is 0 m and its link"),
        ({"link_point": (0.030, 0.545, 0.330)}, "and its link 0 m long"),
        ({"link_body": "left_arm"}, "body 'left_arm' is not in the specimen"),
    ],
)
def test_a_bar_that_could_fold_over_is_refused(front_axle, change, said):
    bar = front_axle.specimen.anti_roll_bars[0].model_copy(update=change)
    with pytest.raises(SpecimenError) as caught:
        assemble(front_axle.specimen.model_copy(update={"anti_roll_bars": (bar,)}), front_axle.model.assembly.tree)
    assert str(caught.value).startswith("specimen front_axle: anti-roll bar 'anti_roll_bar': ")
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")
