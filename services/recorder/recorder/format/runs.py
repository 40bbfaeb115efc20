"""Announced playbacks of a recording, and which of their signal blocks are stored."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from duralab_bus import Continuity
from duralab_proto.v1 import recorder_pb2

MOST_BLOCKS: Final = 2**32
"""Of one playback: the log keeps 32 bits of a sequence number."""


def ranges_of(continuity: Continuity) -> list[range]:
    """Return what was received, as ascending ranges that do not touch."""
    edges = [0]
    for gap in continuity.missing(continuity.next_seq):
        edges += [gap.start, gap.stop]
    edges.append(continuity.next_seq)
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [range(first, stop) for first, stop in pairs if first < stop]


@dataclass
class PlannedRun:
    """A playback that was announced.

    `recording`: Id of the recording that its blocks go to. `played`: The proof of what it consists of, once it was
    played. `epochs`: The blocks stored, for each epoch of their publisher.
    """

    recording: str
    played: recorder_pb2.RunPlayed | None = None
    # One count for each publisher: a playback that is repeated after a fault has a new epoch.
    epochs: dict[int, Continuity] = field(default_factory=dict)

    @property
    def stored(self) -> int:
        """Number of different blocks stored."""
        return sum(continuity.received for continuity in self.epochs.values())

    @property
    def missing(self) -> int:
        """Number of blocks known to be missing: of all that were announced, or else the gaps seen so far."""
        if self.played is not None:
            return self.missing_of(self.played.epoch, self.played.blocks)
        return sum(continuity.next_seq - continuity.received for continuity in self.epochs.values())

    def stored_ranges(self) -> dict[int, list[range]]:
        """Return which blocks are stored, for each epoch, as ascending ranges that do not touch."""
        return {epoch: ranges_of(continuity) for epoch, continuity in self.epochs.items()}

    def missing_of(self, epoch: int, blocks: int) -> int:
        """Count which of the first `blocks` blocks of an epoch are not stored."""
        return sum(len(gap) for gap in self.gaps_of(epoch, blocks))

    def gaps_of(self, epoch: int, blocks: int) -> list[range]:
        """Return which of the first `blocks` blocks of an epoch are not stored."""
        return self.epochs.get(epoch, Continuity()).missing(blocks)
