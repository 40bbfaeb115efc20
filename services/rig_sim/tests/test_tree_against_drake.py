"""The own tree dynamics against Drake: every joint, springs, bushings at large angles."""

import numpy as np
import pytest
from pydrake.multibody.tree import ForceElementIndex, LinearBushingRollPitchYaw

from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.multibody.dynamics import accelerate
from rig_sim.multibody.forces import add_linear_elements
from rig_sim.multibody.kinematics import move
from rig_sim.multibody.spatial import ZERO
from rig_sim.multibody.tree import JointKind

AXES = {"prismatic": "<axis><xyz>0.3 -0.5 0.8</xyz></axis>", "revolute": "<axis><xyz>0.6 0.48 -0.64</xyz></axis>"}

LINK = """
<link name="{name}">
  <pose>{pose}</pose>
  <inertial>
    <pose>0.11 -0.07 0.05 0.3 -0.2 0.5</pose>
    <mass>{mass}</mass>
    <inertia><ixx>0.31</ixx><iyy>0.42</iyy><izz>0.53</izz><ixy>0.02</ixy><ixz>-0.03</ixz><iyz>0.04</iyz></inertia>
  </inertial>
</link>"""

JOINT = """
<joint name="{name}" type="{kind}">
  <pose>0.1 0.2 -0.1 0.4 0.5 -0.6</pose><parent>{parent}</parent><child>{child}</child>{axis}
</joint>"""


def sdf(folder, content):
    path = folder / "model.sdf"
    path.write_text(f'<sdf version="1.9" xmlns:drake="https://drake.mit.edu"><model name="m">{content}</model></sdf>')
    return path


def link(name, pose="0 0 0 0 0 0", mass=3.0):
    return LINK.format(name=name, pose=pose, mass=mass)


def joint(kind, *, parent, child):
    return JOINT.format(name=f"{parent}_{child}", kind=kind, parent=parent, child=child, axis=AXES.get(kind, ""))


def own_accelerations(tree, positions, velocities):
    motion = move(tree, positions, velocities)
    wrenches = [ZERO] * len(tree.bodies)
    add_linear_elements(tree, motion, wrenches)
    solved = accelerate(tree, motion, wrenches, [0.0] * tree.velocity_count)
    return np.array(motion.position_rates, dtype=float), np.array(solved.joint, dtype=float)


def assert_same_as_drake(plant, tree, *, seeds, angle=0.6):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        positions = tree.default_positions + angle * rng.standard_normal(len(tree.default_positions))
        for joint in tree.joints:
            if joint.kind is JointKind.FLOATING:
                quaternion = positions[joint.position_start : joint.position_start + 4]
                quaternion /= np.linalg.norm(quaternion)
        velocities = 2.0 * rng.standard_normal(tree.velocity_count)
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, positions)
        plant.SetVelocities(context, velocities)
        expected = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
        rates, accelerations = own_accelerations(tree, positions, velocities)
        np.testing.assert_allclose(rates, plant.MapVelocityToQDot(context, velocities), rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(accelerations, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic", "ball"])
def test_a_joint_of_every_kind_moves_as_drake_says(tmp_path, kind):
    # Something on either side of the joint in question, and oblique frames everywhere.
    content = link("a") + link("b", "0.5 0.1 0.2 0.2 -0.3 0.4", 2.0) + link("c", "0.9 -0.2 0.1 -0.5 0.2 0.1", 1.5)
    content += joint("revolute", parent="world", child="a") + joint(kind, parent="a", child="b")
    plant = load_plant(sdf(tmp_path, content + joint("revolute", parent="b", child="c")))
    assert_same_as_drake(plant, read_tree(plant), seeds=5)


def test_a_free_body_with_an_arm_tumbles_as_drake_says(tmp_path):
    content = link("a") + link("b", "0.5 0.1 0.2 0.2 -0.3 0.4") + joint("revolute", parent="a", child="b")
    plant = load_plant(sdf(tmp_path, content))
    tree = read_tree(plant)
    assert [joint.kind for joint in tree.joints] == [JointKind.FLOATING, JointKind.REVOLUTE]
    assert_same_as_drake(plant, tree, seeds=8)


BUSHING = """
<frame name="on_a" attached_to="a"><pose relative_to="a">0.2 0.1 -0.3 0.7 -0.4 0.9</pose></frame>
<frame name="on_b" attached_to="b"><pose relative_to="b">-0.1 0.3 0.2 -0.2 0.6 0.3</pose></frame>
<drake:linear_bushing_rpy>
  <drake:bushing_frameA>on_a</drake:bushing_frameA><drake:bushing_frameC>on_b</drake:bushing_frameC>
  <drake:bushing_torque_stiffness>110 70 30</drake:bushing_torque_stiffness>
  <drake:bushing_torque_damping>3 5 7</drake:bushing_torque_damping>
  <drake:bushing_force_stiffness>1000 5000 200</drake:bushing_force_stiffness>
  <drake:bushing_force_damping>20 90 40</drake:bushing_force_damping>
</drake:linear_bushing_rpy>"""

SPRING = """
<drake:linear_spring_damper>
  <drake:linear_spring_damper_body_A>a</drake:linear_spring_damper_body_A>
  <drake:linear_spring_damper_p_AP>0.1 0.2 0.3</drake:linear_spring_damper_p_AP>
  <drake:linear_spring_damper_body_B>b</drake:linear_spring_damper_body_B>
  <drake:linear_spring_damper_p_BQ>-0.2 0.1 0.4</drake:linear_spring_damper_p_BQ>
  <drake:linear_spring_damper_free_length>0.7</drake:linear_spring_damper_free_length>
  <drake:linear_spring_damper_stiffness>900</drake:linear_spring_damper_stiffness>
  <drake:linear_spring_damper_damping>35</drake:linear_spring_damper_damping>
</drake:linear_spring_damper>"""


def test_a_spring_between_two_free_bodies_acts_as_drakes(tmp_path):
    plant = load_plant(sdf(tmp_path, link("a") + link("b", "1 0 0 0 0 0") + SPRING))
    assert_same_as_drake(plant, read_tree(plant), seeds=5)


def test_an_anisotropic_bushing_at_large_angles_acts_as_drakes(tmp_path):
    plant = load_plant(sdf(tmp_path, link("a") + link("b", "0.3 0 0 0 0 0") + BUSHING))
    tree = read_tree(plant)
    elements = [plant.get_force_element(ForceElementIndex(index)) for index in range(plant.num_force_elements())]
    (bushing,) = (element for element in elements if isinstance(element, LinearBushingRollPitchYaw))
    angles = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        positions = np.array([1.0, 0, 0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0.3, 0, 0]) + 0.35 * rng.standard_normal(14)
        positions[:4] /= np.linalg.norm(positions[:4])
        positions[7:11] /= np.linalg.norm(positions[7:11])
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, positions)
        velocities = rng.standard_normal(12)
        plant.SetVelocities(context, velocities)
        motion = move(tree, positions, velocities)
        wrenches = [ZERO] * len(tree.bodies)
        add_linear_elements(tree, motion, wrenches)
        own = tree.bushings[0]
        for body, frame, answer in (
            (own.body_a, own.frame_a, bushing.CalcBushingSpatialForceOnFrameA(context)),
            (own.body_c, own.frame_c, bushing.CalcBushingSpatialForceOnFrameC(context)),
        ):
            pose = motion.poses[body] @ frame
            force = pose.rotation.T @ wrenches[body].linear
            moment = pose.rotation.T @ (wrenches[body].angular - np.cross(pose.origin, wrenches[body].linear))
            np.testing.assert_allclose(force, answer.translational(), rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(moment, answer.rotational(), rtol=1e-9, atol=1e-9)
        frames = [(motion.poses[b] @ f).rotation for b, f in ((own.body_a, own.frame_a), (own.body_c, own.frame_c))]
        angles.append(np.degrees(np.arccos(np.clip((np.trace(frames[0].T @ frames[1]) - 1) / 2, -1, 1))))
    assert max(angles) > 80.0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (link("a") + link("b") + joint("screw", parent="a", child="b"), "ScrewJoint; the player knows BallRpyJoint"),
        (
            link("a")
            + link("b")
            + joint("revolute", parent="a", child="b").replace(
                "</xyz>", "</xyz><dynamics><damping>0.5</damping></dynamics>"
            ),
            "joint 'a_b' has damping [0.5]; put damping into a force element",
        ),
        ("<link", "model.sdf is not XML"),
    ],
)
def test_what_the_player_does_not_know_is_refused(tmp_path, content, said):
    content = content.replace('type="screw">', 'type="screw"><axis><xyz>0 0 1</xyz></axis>')
    with pytest.raises(ValueError) as caught:
        read_tree(load_plant(sdf(tmp_path, content)))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_bodies_of_one_name_are_refused(tmp_path):
    path = tmp_path / "model.sdf"
    models = "".join(f'<model name="{name}">{link("a")}</model>' for name in ("m", "n"))
    path.write_text(f'<sdf version="1.9"><world name="w">{models}</world></sdf>')
    with pytest.raises(ValueError, match="two bodies of the SDF are called 'a'"):
        read_tree(load_plant(path))


def test_a_missing_sdf_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"the SDF nowhere\.sdf is missing"):
        load_plant(tmp_path / "nowhere.sdf")
