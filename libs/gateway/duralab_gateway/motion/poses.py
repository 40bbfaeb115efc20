"""Conversion of rotation matrices to the quaternions of the pose stream."""

from __future__ import annotations

import numpy as np


def to_poses(frames: np.ndarray) -> np.ndarray:
    """Convert frames (…, 12), rotation row by row, then origin in m, to poses (…, 7) for many instants at once.

    A pose is x, y, z in m, then the unit quaternion w, x, y, z with w >= 0, body to world. The largest of the four
    elements is computed from the diagonal, the others from it (Shepperd 1978): no division by a small number.
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
