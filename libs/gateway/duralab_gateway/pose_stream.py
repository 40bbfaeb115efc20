"""Body poses while a rig plays, for a 3-D view: no more than 60 a simulated second, several to a message."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from duralab_bus import Bus, SpoolSpace
from duralab_gateway.motion import to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import rig_pb2

LARGEST_RATE = 60.0
_POSES = 10
# Nobody stores poses: a view that missed the last seconds of them may still have them.
_KEPT_BYTES = 2**20


class PoseStream:
    """Gathers and publishes the poses of one rig."""

    def __init__(self, bus: Bus, rig: str) -> None:
        self._publisher = bus.publisher(bus.keys.rig_pose(rig), spools=SpoolSpace(8 * _KEPT_BYTES))
        self.begin("")

    def begin(self, run: str) -> None:
        """Begin a run; its time counts from zero."""
        self._run = run
        self._times: list[float] = []
        self._frames: list[np.ndarray] = []
        self._next = 0.0

    def add(self, seconds: float, frames: Callable[[], np.ndarray | None]) -> None:
        """Take the frames (bodies, 12) at a time of the run; not asked for where they would come too often."""
        if seconds < self._next or (shown := frames()) is None:
            return
        self._next = seconds + 1.0 / LARGEST_RATE
        self._times.append(seconds)
        self._frames.append(shown)
        if len(self._times) >= _POSES:
            self.flush()

    def flush(self) -> None:
        """Publish what was gathered."""
        if not self._times:
            return
        block = rig_pb2.PoseBlock(
            run=self._run, time=to_array(np.array(self._times)), poses=to_array(to_poses(np.stack(self._frames)))
        )
        self._times, self._frames = [], []
        self._publisher.put(block)
