"""The force elements that SDF can state: linear springs with dampers, and Drake's linear bushing."""

from __future__ import annotations

import numpy as np

from rig_sim.compile import sqrt
from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import (
    Array,
    Spatial,
    cross,
    dot,
    quaternion_from_rotation,
    roll_pitch_yaw,
    roll_pitch_yaw_rates,
    rotation_from_quaternion,
    wrench_at,
)
from rig_sim.multibody.tree import Bushing, MultibodyTree, SpringDamper


def stretch(motion: Motion, body_a: int, point_a: np.ndarray, body_b: int, point_b: np.ndarray) -> tuple[Array, ...]:
    """Return how two points lie and move to each other."""
    a, velocity_a = motion.point(body_a, point_a)
    b, velocity_b = motion.point(body_b, point_b)
    along = b - a
    length = sqrt(dot(along, along))
    direction = along * (1.0 / length)
    return a, b, direction, length, dot(direction, velocity_b - velocity_a)


def add_linear_elements(tree: MultibodyTree, motion: Motion, wrenches: list[Spatial]) -> None:
    """Add the wrenches of all springs and bushings of the SDF to the bodies' wrenches (about the world's origin)."""
    for spring in tree.springs:
        _add_spring(spring, motion, wrenches)
    for bushing in tree.bushings:
        wrench = bushing_wrench(bushing, motion)
        wrenches[bushing.body_c] = wrenches[bushing.body_c] + wrench
        wrenches[bushing.body_a] = wrenches[bushing.body_a] - wrench


def _add_spring(spring: SpringDamper, motion: Motion, wrenches: list[Spatial]) -> None:
    a, _, direction, length, rate = stretch(motion, spring.body_a, spring.point_a, spring.body_b, spring.point_b)
    pull = (length - spring.free_length) * spring.stiffness + rate * spring.damping
    wrench = wrench_at(a, direction * pull)
    wrenches[spring.body_a] = wrenches[spring.body_a] + wrench
    wrenches[spring.body_b] = wrenches[spring.body_b] - wrench


def bushing_wrench(bushing: Bushing, motion: Motion) -> Spatial:
    """Return what a bushing does to its body C, about the world's origin; body A gets the opposite.

    Drake's law: the force in the frame half-way (by angle) between A and C, the moment by roll, pitch, yaw. Taking an
    anisotropic bushing in frame A instead gave errors of tens of per cent in the spindle force.
    """
    frame_a = motion.poses[bushing.body_a] @ bushing.frame_a
    frame_c = motion.poses[bushing.body_c] @ bushing.frame_c
    turn = frame_a.rotation.T @ frame_c.rotation
    spin = frame_a.rotation.T @ (motion.velocities[bushing.body_c].angular - motion.velocities[bushing.body_a].angular)

    quaternion = quaternion_from_rotation(turn)
    halfway = rotation_from_quaternion(np.array([1.0 + quaternion[0], *quaternion[1:]]))
    offset = frame_a.rotation.T @ (frame_c.origin - frame_a.origin)
    between = motion.velocities[bushing.body_c].at(frame_c.origin) - motion.velocities[bushing.body_a].at(
        frame_a.origin
    )
    # Velocity of Co in A; then the rate of the offset's components in the half-way frame.
    spin_a = frame_a.rotation.T @ motion.velocities[bushing.body_a].angular
    rate = frame_a.rotation.T @ between - cross(spin_a, offset)
    displacement = halfway.T @ offset
    displacement_rate = halfway.T @ (rate - cross(spin * 0.5, offset))
    force_b = -(bushing.force_stiffness * displacement + bushing.force_damping * displacement_rate)

    force = frame_a.rotation @ (halfway @ force_b)
    total = wrench_at((frame_a.origin + frame_c.origin) * 0.5, force)
    if np.any(bushing.torque_stiffness) or np.any(bushing.torque_damping):
        angles = roll_pitch_yaw(turn)
        to_rates = roll_pitch_yaw_rates(angles)
        gimbal = -(bushing.torque_stiffness * angles + bushing.torque_damping * (to_rates @ spin))
        moment = frame_a.rotation @ (to_rates.T @ gimbal)
        total = Spatial(total.angular + moment, total.linear)
    return total
