"""Accelerations of the tree: composite rigid bodies and a factorisation L'DL that keeps the tree's zeros.

Featherstone, *Rigid Body Dynamics Algorithms*, chapters 6 and 8. Written over generic scalars, so that the same lines
are traced into compiled code, evaluated in plain numpy, and proven against Drake.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import ZERO, Array, Spatial, cross
from rig_sim.multibody.tree import Body, JointKind, MultibodyTree, Pose


@dataclass(frozen=True)
class Inertia:
    """A rigid-body inertia about the world's origin in world axes: mass, first moment (3,), second moment (3, 3)."""

    mass: Any
    first_moment: Array
    second_moment: Array

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.mass + other.mass, self.first_moment + other.first_moment, self.second_moment + other.second_moment
        )

    def momentum(self, motion: Spatial) -> Spatial:
        """Return the wrench of a motion (velocity or acceleration) of this inertia."""
        return Spatial(
            self.second_moment @ motion.angular + cross(self.first_moment, motion.linear),
            motion.linear * self.mass - cross(self.first_moment, motion.angular),
        )


def inertia_in_world(body: Body, pose: Pose) -> Inertia:
    """Return the inertia of a body at a pose, about the world's origin in world axes."""
    rotation, origin = pose.rotation, pose.origin
    own_moment = rotation @ (body.mass * body.centre)
    first = own_moment + origin * body.mass
    # J about the world's origin = R J R' + m(p.p) - m pp' + 2(p.h) - ph' - hp', h = m c the first moment.
    spread = body.mass * (origin @ origin) + 2.0 * (origin @ own_moment)
    products = np.outer(origin, origin) * body.mass + np.outer(origin, own_moment) + np.outer(own_moment, origin)
    second = _turned(body.inertia, rotation) + np.eye(3) * spread - products
    return Inertia(body.mass, first, second)


def _turned(symmetric: np.ndarray, rotation: Array) -> Array:
    """Return R J R', each pair of equal elements computed once."""
    half = rotation @ symmetric
    turned: Array = np.empty((3, 3), dtype=object)
    for i in range(3):
        for j in range(i, 3):
            turned[i, j] = turned[j, i] = half[i] @ rotation[j]
    return turned


def _welds_merged(tree: MultibodyTree) -> list[Body]:
    """Return the bodies, each with the inertia of its welded bodies, which then have none."""
    bodies = list(tree.bodies)
    for joint in reversed(tree.joints):
        if joint.kind is JointKind.WELD:
            child, parent = bodies[joint.child], bodies[joint.parent]
            moved = inertia_in_world(child, joint.frame_on_parent @ joint.frame_on_child.inverse())
            mass = parent.mass + child.mass
            first = np.array(parent.mass * parent.centre + moved.first_moment, dtype=float)
            bodies[joint.parent] = replace(
                parent,
                mass=mass,
                centre=first / mass if mass > 0.0 else parent.centre,
                inertia=np.array(parent.inertia + moved.second_moment, dtype=float),
            )
            bodies[joint.child] = replace(child, mass=0.0, centre=np.zeros(3), inertia=np.zeros((3, 3)))
    return bodies


@dataclass(frozen=True)
class Accelerations:
    """Accelerations of the degrees of freedom, and of the bodies relative to free fall."""

    #: (n_v,) in m/s^2 or rad/s^2.
    joint: list[Any]
    #: Spatial acceleration of each body minus gravity.
    proper: list[Spatial]


def accelerate(tree: MultibodyTree, motion: Motion, wrenches: list[Spatial], joint_forces: Array) -> Accelerations:
    """Return the accelerations under external wrenches and joint forces, in N*m or N, both without gravity.

    The wrenches are sums on each body about the world's origin.
    """
    inertias = [inertia_in_world(body, pose) for body, pose in zip(_welds_merged(tree), motion.poses, strict=True)]
    root = Spatial(np.zeros(3), -tree.gravity)
    bias = [root] * len(tree.bodies)
    for index, joint in enumerate(tree.joints):
        bias[joint.child] = bias[joint.parent] + motion.bias_accelerations[index]
    forces = [
        inertia.momentum(acceleration) + velocity.force_cross(inertia.momentum(velocity)) - wrench
        for inertia, acceleration, velocity, wrench in zip(inertias, bias, motion.velocities, wrenches, strict=True)
    ]

    n = tree.velocity_count
    mass = np.full((n, n), 0.0, dtype=object)
    rest: list[Any] = [0.0] * n
    composite = list(inertias)
    for index in reversed(range(len(tree.joints))):
        joint = tree.joints[index]
        for i, axis in enumerate(motion.axes[index]):
            row = joint.velocity_start + i
            rest[row] = joint_forces[row] - axis.power(forces[joint.child])
            momentum = composite[joint.child].momentum(axis)
            _fill_mass_row(mass, row, tree, motion, joint_index=index, momentum=momentum)
        composite[joint.parent] = composite[joint.parent] + composite[joint.child]
        forces[joint.parent] = forces[joint.parent] + forces[joint.child]

    joint_accelerations = _solve(mass, rest)
    proper = [root] * len(tree.bodies)
    for index, joint in enumerate(tree.joints):
        own = ZERO
        for i, axis in enumerate(motion.axes[index]):
            own = own + axis * joint_accelerations[joint.velocity_start + i]
        proper[joint.child] = proper[joint.parent] + motion.bias_accelerations[index] + own
    return Accelerations(joint_accelerations, proper)


def _fill_mass_row(
    mass: np.ndarray, row: int, tree: MultibodyTree, motion: Motion, *, joint_index: int, momentum: Spatial
) -> None:
    """Fill the row of one freedom: its own joint and all joints between it and the world."""
    index = joint_index
    while index >= 0:
        joint = tree.joints[index]
        for i, axis in enumerate(motion.axes[index]):
            column = joint.velocity_start + i
            mass[row, column] = mass[column, row] = axis.power(momentum)
        index = next((k for k, other in enumerate(tree.joints) if other.child == joint.parent), -1)


def _solve(mass: np.ndarray, right: list[Any]) -> list[Any]:
    """Solve M a = r by M = L'DL, from the leaves inward, without structural zeros."""
    n = len(right)
    order = _leaves_first(mass)
    factor: dict[tuple[int, int], Any] = {}
    solution = list(right)
    matrix = mass.copy()
    done: list[int] = []
    for k in order:
        later = [i for i in range(n) if i not in done and i != k and not _is_zero(matrix[k, i])]
        inverse = 1.0 / matrix[k, k]
        for position, i in enumerate(later):
            ratio = matrix[k, i] * inverse
            factor[k, i] = ratio
            solution[i] = solution[i] - ratio * solution[k]
            for j in later[position:]:
                matrix[i, j] = matrix[j, i] = matrix[i, j] - ratio * matrix[k, j]
        done.append(k)
        matrix[k, k] = inverse
    for k in order:
        solution[k] = solution[k] * matrix[k, k]
    for k in reversed(order):
        for (row, i), ratio in factor.items():
            if row == k:
                solution[k] = solution[k] - ratio * solution[i]
    return solution


def _leaves_first(mass: np.ndarray) -> list[int]:
    """Order the freedoms greedily by the number of coupled others, so that elimination adds few elements.

    Of equals the outermost comes first: a body between two sides must wait for both, or they lose their symmetry.
    """
    n = len(mass)
    neighbours = [{j for j in range(n) if j != i and not _is_zero(mass[i, j])} for i in range(n)]
    order: list[int] = []
    remaining = set(range(n))
    while remaining:
        k = min(remaining, key=lambda i: (len(neighbours[i] & remaining), -i))
        remaining.discard(k)
        coupled = neighbours[k] & remaining
        for i in coupled:
            neighbours[i] |= coupled - {i}
        order.append(k)
    return order


def _is_zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0
