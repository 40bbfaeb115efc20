"""Tree of rigid bodies as plain numbers: the data of a finalised Drake plant that the player needs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np


class JointKind(Enum):
    """Joints of the player, with Drake's coordinates."""

    WELD = auto()
    REVOLUTE = auto()
    PRISMATIC = auto()
    #: Three rotations; positions are roll, pitch, yaw, velocities the angular velocity in the parent's frame.
    BALL = auto()
    #: Six freedoms in the world: a quaternion (w, x, y, z) and the origin; velocities angular, then linear.
    FLOATING = auto()


@dataclass(frozen=True)
class Pose:
    """A frame in another frame: rotation (3, 3), axes as columns, and origin (3,) in metres."""

    rotation: np.ndarray
    origin: np.ndarray

    def __matmul__(self, other: Pose) -> Pose:
        """Chain two poses."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.origin + self.origin)

    def inverse(self) -> Pose:
        """Return the pose of the other frame in this one."""
        return Pose(self.rotation.T, -self.rotation.T @ self.origin)


@dataclass(frozen=True)
class Body:
    """A rigid body: mass in kg, centre of mass in m and inertia about the body's origin in kg*m^2, in its own frame."""

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Joint:
    """A joint from a parent body to a child body; frames F on the parent and M on the child."""

    name: str
    kind: JointKind
    parent: int
    child: int
    frame_on_parent: Pose
    frame_on_child: Pose
    #: Unit axis in F, for REVOLUTE and PRISMATIC.
    axis: np.ndarray
    #: Start and number of its positions and velocities.
    position_start: int
    positions: int
    velocity_start: int
    velocities: int


@dataclass(frozen=True)
class SpringDamper:
    """A linear spring and damper between two points: free length m, stiffness N/m, damping N*s/m."""

    name: str
    body_a: int
    point_a: np.ndarray
    body_b: int
    point_b: np.ndarray
    free_length: float
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Bushing:
    """Drake's linear bushing between frame A on one body and frame C on another.

    Constants are (3,): forces along x, y, z of the frame half-way between A and C, in N/m and N*s/m; torques about
    roll, pitch, yaw of C in A, in N*m/rad and N*m*s/rad.
    """

    name: str
    body_a: int
    frame_a: Pose
    body_c: int
    frame_c: Pose
    torque_stiffness: np.ndarray
    torque_damping: np.ndarray
    force_stiffness: np.ndarray
    force_damping: np.ndarray


@dataclass(frozen=True)
class MultibodyTree:
    """Bodies (the world is body 0), joints from the world outward, force elements, gravity in m/s^2, default pose.

    Every parent is reached before its children. A named frame has the index of its body and its pose in it.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    springs: tuple[SpringDamper, ...]
    bushings: tuple[Bushing, ...]
    gravity: np.ndarray
    default_positions: np.ndarray
    velocity_count: int
    frames: dict[str, tuple[int, Pose]]

    def body_index(self, name: str) -> int:
        """Return the index of the body of that name, or raise `ValueError` with those that exist."""
        for index, body in enumerate(self.bodies):
            if body.name == name:
                return index
        raise ValueError(
            f"body {name!r} is not in the specimen; its bodies are {', '.join(body.name for body in self.bodies)}."
        )

    def joint(self, name: str) -> Joint:
        """Return the joint of that name, or raise `ValueError` with those that exist."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        known = ", ".join(joint.name for joint in self.joints) or "none"
        raise ValueError(f"joint {name!r} is not in the specimen; its joints are {known}.")

    def frame(self, name: str) -> tuple[int, Pose]:
        """Return body and pose in the body of the frame of that name, or raise `ValueError` with those that exist."""
        if name not in self.frames:
            raise ValueError(f"frame {name!r} is not in the specimen; its frames are {', '.join(sorted(self.frames))}.")
        return self.frames[name]
