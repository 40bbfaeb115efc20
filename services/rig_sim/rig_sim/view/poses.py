"""Where the bodies of a rig are: for a 3-D view of a playback."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig_sim.compile.model import compile_model
from rig_sim.multibody.kinematics import move
from rig_sim.multibody.tree import MultibodyTree

_NUMBERS = 12


class Poses:
    """Forward kinematics of a tree, compiled: straight from Drake's positions to poses of all bodies but the world.

    Parameters
    ----------
    tree : MultibodyTree
        Whose bodies are shown.
    """

    def __init__(self, tree: MultibodyTree) -> None:
        self.bodies = tuple(body.name for body in tree.bodies[1:])
        still = np.zeros(tree.velocity_count)

        def kinematics(positions: Any, _inputs: Any) -> tuple[list[Any], list[Any]]:
            poses = move(tree, positions, still).poses[1:]
            outputs = [number for pose in poses for number in [*np.asarray(pose.rotation).flat, *pose.origin]]
            return [0.0] * len(tree.default_positions), outputs

        self._compiled = compile_model(
            kinematics,
            state_names=tuple(f"position {index}" for index in range(len(tree.default_positions))),
            input_names=(),
            output_names=tuple(f"{body} {index}" for body in self.bodies for index in range(_NUMBERS)),
            # Some 10 µs for each instant that is drawn either way, and a quarter of a second sooner ready.
            lanes=False,
            optimization=0,
        )

    def frames(self, positions: np.ndarray) -> np.ndarray:
        """Return rotation matrices and origins: the cheap half, for one instant.

        Parameters
        ----------
        positions : (n_q,)
            Drake's positions.

        Returns
        -------
        ndarray, (bodies, 12)
            Rotation row by row, then the origin in m.
        """
        return self._compiled.outputs(positions, np.zeros(0)).reshape(len(self.bodies), _NUMBERS)


def to_poses(frames: np.ndarray) -> np.ndarray:
    """Turn rotation matrices into quaternions, for many instants at once.

    Parameters
    ----------
    frames : (instants, bodies, 12)
        Of `Poses.frames`.

    Returns
    -------
    ndarray, (instants, bodies, 7)
        x, y, z in m, then the unit quaternion w, x, y, z with w >= 0, body to world.

    Notes
    -----
    The largest of the four elements is computed from the diagonal, the others from it (Shepperd 1978): no division by a
    small number.
    """
    matrix = frames[..., :9].reshape(*frames.shape[:-1], 3, 3)
    xx, yy, zz = matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 2, 2]
    # Row k of the symmetric matrix 4 q q^T, divided by the root of its diagonal, is 2 q.
    outer = np.empty((*frames.shape[:-1], 4, 4))
    outer[..., 0, 0] = 1.0 + xx + yy + zz
    outer[..., 1, 1] = 1.0 + xx - yy - zz
    outer[..., 2, 2] = 1.0 - xx + yy - zz
    outer[..., 3, 3] = 1.0 - xx - yy + zz
    for row, column, value in (
        (0, 1, matrix[..., 2, 1] - matrix[..., 1, 2]),
        (0, 2, matrix[..., 0, 2] - matrix[..., 2, 0]),
        (0, 3, matrix[..., 1, 0] - matrix[..., 0, 1]),
        (1, 2, matrix[..., 0, 1] + matrix[..., 1, 0]),
        (1, 3, matrix[..., 0, 2] + matrix[..., 2, 0]),
        (2, 3, matrix[..., 1, 2] + matrix[..., 2, 1]),
    ):
        outer[..., row, column] = outer[..., column, row] = value
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    quaternion = np.take_along_axis(outer, largest, axis=-2)[..., 0, :]
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    quaternion *= np.where(quaternion[..., :1] < 0.0, -1.0, 1.0)
    return np.concatenate([frames[..., 9:], quaternion], axis=-1)
