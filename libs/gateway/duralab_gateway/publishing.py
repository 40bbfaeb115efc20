"""Publishing during a playback: signal blocks at the pace of the clock, and body poses for a 3-D view."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from duralab_bus import Bus, SpoolFullError, SpoolSpace, StreamPublisher
from duralab_gateway.motion import Block, to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import rig_pb2

_NOTHING = np.empty((0, 0))


class BlockPublisher:
    """Publisher of the blocks of one run: gathers slices of a block, and counts the blocks.

    `size` is the number of gathered samples, `limit` the largest number in a message, and `hold` keeps all of them back
    until the run is over.
    """

    def __init__(
        self, publisher: StreamPublisher, run: str, rate: float, *, size: int, limit: int, hold: bool = False
    ) -> None:
        self.publisher = publisher
        self._run = run
        self._rate = rate
        self._size = size
        self._limit = limit
        self._hold = hold
        self._slices: list[Block] = []
        self.blocks = 0
        self.refusal = ""
        """Reason why a block could not be published; the block is sent with the next one."""

    def __call__(self, block: Block, *, last: bool) -> None:
        """Add a block; publish the gathered ones if they are enough, or the last."""
        self._slices.append(block)
        gathered = not self._hold and sum(part.drive.shape[1] for part in self._slices) >= self._size
        if last or gathered:
            self.flush(last=last)

    def flush(self, *, last: bool) -> None:
        """Publish the samples that are still buffered."""
        if not self._slices:
            return
        first = self._slices[0].first_sample
        drive = _joined([part.drive for part in self._slices])
        response = _joined([part.response for part in self._slices])
        samples = drive.shape[1]
        for begin in range(0, samples, self._limit):
            end = min(begin + self._limit, samples)
            block = rig_pb2.SignalBlock(
                run=self._run,
                first_sample=first + begin,
                sample_rate=self._rate,
                drive=to_array(drive[:, begin:end]),
                response=to_array(response[:, begin:end]),
                last=last and end == samples,
            )
            try:
                self.publisher.put(block)
            except SpoolFullError as error:
                self.refusal = str(error).rstrip(".")
                left = slice(begin, samples)
                self._slices = [Block(first + begin, drive[:, left], response[:, left], _NOTHING, _NOTHING)]
                return
            self.blocks += 1
        self.refusal = ""
        self._slices.clear()


def _joined(pieces: list[np.ndarray]) -> np.ndarray:
    return pieces[0] if len(pieces) == 1 else np.hstack(pieces)


class Clock:
    """Clock that a playback in real time must keep to; it runs from the first block on."""

    def __init__(self, rate: float, *, real_time: bool) -> None:
        self._rate = rate
        self.real_time = real_time
        self._origin: int | None = None
        self._started = 0.0

    def ahead(self, block: Block) -> float:
        """Return the time in s to wait at the end of a block."""
        if not self.real_time:
            return 0.0
        if self._origin is None:
            self._origin, self._started = block.first_sample, time.monotonic()
        return max((block.end - self._origin) / self._rate - (time.monotonic() - self._started), 0.0)


LARGEST_RATE = 60.0
_POSES = 10
# A playback faster than real time has its poses published at the pace of the clock: each message costs far more than
# its content.
_POSES_SECONDS = _POSES / LARGEST_RATE
# Of a dozen bodies, half of what fits one batch of Zenoh's (64 KB).
_MOST_POSES = 5 * _POSES
# No service stores poses: a view that missed the last seconds can still request them.
_KEPT_BYTES = 2**20


class PoseStream:
    """Publisher that gathers the poses of one rig."""

    def __init__(self, bus: Bus, rig: str) -> None:
        self._publisher = bus.publisher(bus.keys.rig_pose(rig), spools=SpoolSpace(8 * _KEPT_BYTES))
        self.begin("")

    def begin(self, run: str) -> None:
        """Begin a run; its time counts from zero."""
        self._run = run
        self._times: list[float] = []
        self._frames: list[np.ndarray] = []
        self._next = 0.0
        self._published_at = time.monotonic()

    def add(self, instants: Sequence[int], rate: float, frames: Callable[[Sequence[int]], np.ndarray | None]) -> None:
        """Add the frames (instants, bodies, 12) at some samples of the run, those that do not come too often."""
        wanted = []
        for instant in instants:
            if instant / rate >= self._next:
                self._next = instant / rate + 1.0 / LARGEST_RATE
                wanted.append(instant)
        if not wanted or (shown := frames(wanted)) is None:
            return
        self._times.extend(instant / rate for instant in wanted)
        self._frames.extend(shown)
        enough = len(self._times) >= _POSES and time.monotonic() - self._published_at >= _POSES_SECONDS
        if enough or len(self._times) >= _MOST_POSES:
            self.flush()

    def flush(self) -> None:
        """Publish the poses that are still buffered."""
        if not self._times:
            return
        block = rig_pb2.PoseBlock(
            run=self._run, time=to_array(np.array(self._times)), poses=to_array(to_poses(np.stack(self._frames)))
        )
        self._times, self._frames, self._published_at = [], [], time.monotonic()
        self._publisher.put(block)
