"""Poses, velocities and joint axes of every body, over generic scalars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig_sim.multibody.spatial import (
    ZERO,
    Array,
    Spatial,
    cross,
    quaternion_rate,
    roll_pitch_yaw_rates,
    rotation_about,
    rotation_from_quaternion,
    rotation_from_roll_pitch_yaw,
)
from rig_sim.multibody.tree import Joint, JointKind, MultibodyTree, Pose

_WORLD = Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Motion:
    """Motion of the bodies: pose and velocity of each body, freedoms of each joint.

    Each joint has one spatial velocity per freedom, the acceleration of its child without any joint acceleration, and
    the rates of its positions.
    """

    poses: list[Pose]
    velocities: list[Spatial]
    axes: list[list[Spatial]]
    bias_accelerations: list[Spatial]
    position_rates: list[Array]
    joint_positions: Array
    joint_velocities: Array

    def point(self, body: int, point: np.ndarray) -> tuple[Array, Array]:
        """Return position [m] and velocity [m/s] in the world of a point given in the body's frame."""
        position = self.poses[body].rotation @ point + self.poses[body].origin
        return position, self.velocities[body].at(position)


def move(tree: MultibodyTree, positions: Array, velocities: Array) -> Motion:
    """Return the motion of the tree at Drake's positions and velocities, in m and rad, quaternions by elements."""
    poses: list[Pose] = [_WORLD] * len(tree.bodies)
    spatial: list[Spatial] = [ZERO] * len(tree.bodies)
    axes: list[list[Spatial]] = []
    biases: list[Spatial] = []
    rates: list[Array] = [0.0] * len(tree.default_positions)
    for joint in tree.joints:
        frame = poses[joint.parent] @ joint.frame_on_parent
        across, joint_rates = _across(joint, positions, velocities)
        pose = frame @ across @ joint.frame_on_child.inverse()
        columns = _axes(joint, frame, across)
        own = ZERO
        for index, column in enumerate(columns):
            own = own + column * velocities[joint.velocity_start + index]
        poses[joint.child] = pose
        spatial[joint.child] = spatial[joint.parent] + own
        axes.append(columns)
        biases.append(_bias(joint, spatial[joint.parent], own, velocities))
        rates[joint.position_start : joint.position_start + len(joint_rates)] = joint_rates
    return Motion(poses, spatial, axes, biases, rates, positions, velocities)


def _across(joint: Joint, positions: Array, velocities: Array) -> tuple[Pose, list[Array]]:
    """Return the pose of M in F and the rates of the joint's positions."""
    q, v = joint.position_start, joint.velocity_start
    match joint.kind:
        case JointKind.WELD:
            return _WORLD, []
        case JointKind.REVOLUTE:
            return Pose(rotation_about(joint.axis, positions[q]), np.zeros(3)), [velocities[v]]
        case JointKind.PRISMATIC:
            return Pose(np.eye(3), joint.axis * positions[q]), [velocities[v]]
        case JointKind.BALL:
            angles = positions[q : q + 3]
            rates = roll_pitch_yaw_rates(angles) @ velocities[v : v + 3]
            return Pose(rotation_from_roll_pitch_yaw(angles), np.zeros(3)), list(rates)
        case JointKind.FLOATING:
            quaternion = positions[q : q + 4]
            rates = [*quaternion_rate(quaternion, velocities[v : v + 3]), *velocities[v + 3 : v + 6]]
            return Pose(rotation_from_quaternion(quaternion), positions[q + 4 : q + 7]), rates


def _axes(joint: Joint, frame: Pose, across: Pose) -> list[Spatial]:
    match joint.kind:
        case JointKind.WELD:
            return []
        case JointKind.REVOLUTE:
            axis = frame.rotation @ joint.axis
            return [Spatial(axis, cross(frame.origin, axis))]
        case JointKind.PRISMATIC:
            return [Spatial(np.zeros(3), frame.rotation @ joint.axis)]
        case JointKind.BALL:
            return [Spatial(axis, cross(frame.origin, axis)) for axis in frame.rotation.T]
        case JointKind.FLOATING:
            turns = [Spatial(axis, cross(across.origin, axis)) for axis in np.eye(3)]
            return turns + [Spatial(np.zeros(3), axis) for axis in np.eye(3)]


def _bias(joint: Joint, parent: Spatial, own: Spatial, velocities: Array) -> Spatial:
    if joint.kind is JointKind.FLOATING:
        # The rotation axes go through the moving origin of the body.
        v = joint.velocity_start
        return Spatial(np.zeros(3), cross(velocities[v + 3 : v + 6], velocities[v : v + 3]))
    return parent.motion_cross(own)
