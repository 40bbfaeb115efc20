"""Rotations, and spatial vectors about the world's origin in world axes, over generic scalars.

A spatial velocity is (angular velocity, velocity of the body's point at the world's origin); a wrench is (moment about
the world's origin, force). With one reference point for all bodies, nothing needs to be shifted along the tree
(Featherstone, *Rigid Body Dynamics Algorithms*, chapter 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rig_sim.compile import atan2, cos, sin, sqrt

#: An array of floats, or of traced expressions with dtype object.
Array = Any


def vector(*elements: Any) -> Array:
    """Return a (3,) array that keeps expressions unchanged and floats as floats."""
    array = np.array(elements)
    return array if array.dtype == object else array.astype(float)


def cross(a: Array, b: Array) -> Array:
    """Return the vector product of two (3,) arrays."""
    return vector(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Array, b: Array) -> Any:
    """Return the scalar product of two (3,) arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@dataclass(frozen=True)
class Spatial:
    """A spatial velocity or acceleration (angular, linear), or a wrench (moment, force): two (3,) arrays."""

    angular: Array
    linear: Array

    def __add__(self, other: Spatial) -> Spatial:
        return Spatial(self.angular + other.angular, self.linear + other.linear)

    def __sub__(self, other: Spatial) -> Spatial:
        return Spatial(self.angular - other.angular, self.linear - other.linear)

    def __mul__(self, factor: Any) -> Spatial:
        return Spatial(self.angular * factor, self.linear * factor)

    def __neg__(self) -> Spatial:
        return Spatial(-self.angular, -self.linear)

    def motion_cross(self, motion: Spatial) -> Spatial:
        """Return the rate of a motion that is fixed in a body moving with this velocity."""
        return Spatial(
            cross(self.angular, motion.angular), cross(self.angular, motion.linear) + cross(self.linear, motion.angular)
        )

    def force_cross(self, wrench: Spatial) -> Spatial:
        """Return the rate of a wrench (or momentum) that is fixed in a body moving with this velocity."""
        return Spatial(
            cross(self.angular, wrench.angular) + cross(self.linear, wrench.linear), cross(self.angular, wrench.linear)
        )

    def power(self, wrench: Spatial) -> Any:
        """Return the power of a wrench on this velocity."""
        return dot(self.angular, wrench.angular) + dot(self.linear, wrench.linear)

    def at(self, point: Array) -> Array:
        """Return the velocity of the body's point that is at `point` in the world."""
        return self.linear + cross(self.angular, point)


ZERO = Spatial(np.zeros(3), np.zeros(3))


def wrench_at(point: Array, force: Array) -> Spatial:
    """Return the wrench of a force in newtons acting at a point of the world."""
    return Spatial(cross(point, force), force)


def rotation_about(axis: np.ndarray, angle: Any) -> Array:
    """Return the rotation by an angle about a constant axis (Rodrigues)."""
    c, s = cos(angle), sin(angle)
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.outer(axis, axis) * (1.0 - c) + np.eye(3) * c + skew * s


def rotation_from_roll_pitch_yaw(angles: Array) -> Array:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll)."""
    axes = np.eye(3)
    return rotation_about(axes[2], angles[2]) @ rotation_about(axes[1], angles[1]) @ rotation_about(axes[0], angles[0])


def rotation_from_quaternion(q: Array) -> Array:
    """Return the rotation of a quaternion (w, x, y, z) of any length: integration drift does not shear the body."""
    w, x, y, z = q
    scale = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)],
            [scale * (x * y + w * z), 1.0 - scale * (x * x + z * z), scale * (y * z - w * x)],
            [scale * (x * z - w * y), scale * (y * z + w * x), 1.0 - scale * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Array) -> Array:
    """Return the quaternion (w, x, y, z) of a rotation by less than half a turn, where w stays well above zero."""
    w = 0.5 * sqrt(1.0 + rotation[0, 0] + rotation[1, 1] + rotation[2, 2])
    quarter = 0.25 / w
    return np.array(
        [
            w,
            (rotation[2, 1] - rotation[1, 2]) * quarter,
            (rotation[0, 2] - rotation[2, 0]) * quarter,
            (rotation[1, 0] - rotation[0, 1]) * quarter,
        ]
    )


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return roll, pitch, yaw [rad] of a rotation, for pitch below a quarter turn."""
    return vector(
        atan2(rotation[2, 1], rotation[2, 2]),
        atan2(-rotation[2, 0], sqrt(rotation[0, 0] * rotation[0, 0] + rotation[1, 0] * rotation[1, 0])),
        atan2(rotation[1, 0], rotation[0, 0]),
    )


def roll_pitch_yaw_rates(angles: Array) -> Array:
    """Return N (3, 3): rates of roll, pitch, yaw = N @ angular velocity in the parent's axes."""
    c1, s1 = cos(angles[1]), sin(angles[1])
    c2, s2 = cos(angles[2]), sin(angles[2])
    inverse = 1.0 / c1  # A division takes as long as several products.
    tangent = s1 * inverse
    return np.array([[c2 * inverse, s2 * inverse, 0.0], [-s2, c2, 0.0], [c2 * tangent, s2 * tangent, 1.0]])


def quaternion_rate(q: Array, angular_velocity: Array) -> Array:
    """Return the rate of a quaternion (w, x, y, z) under an angular velocity in world axes."""
    w, imaginary = q[0], q[1:]
    rate = angular_velocity * w + cross(angular_velocity, imaginary)
    return np.array([-0.5 * dot(imaginary, angular_velocity), *(0.5 * rate)])
