"""Where the bodies of a rig are: for a 3-D view of a playback."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig_sim.compile import compile_model
from rig_sim.multibody import MultibodyTree, move

_NUMBERS = 12


class Poses:
    """Forward kinematics of a tree, compiled: straight from Drake's positions to poses of all bodies but the world.

    `tree`: Whose bodies are shown.
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

        `positions`: Drake's positions.
        Returns: Rotation row by row, then the origin in m.
        """
        return self._compiled.outputs(positions, np.zeros(0)).reshape(len(self.bodies), _NUMBERS)
