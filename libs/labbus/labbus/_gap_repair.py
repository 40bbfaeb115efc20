"""Fills the gaps of a stream from its publishers' spools, while it is received."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, Generic

import structlog

from labbus._continuity import Continuity
from labbus._encoding import MessageT
from labbus._faults import BusError, FaultError
from labbus._stream_item import StreamItem

_FOLLOWED_PUBLISHERS: Final = 256
"""Publishers whose numbers are remembered: every playback has one, and a lab runs for months."""

Replay = Callable[[str, int, list[range]], list[StreamItem[MessageT]]]
"""Called with key, epoch and the missing numbers; returns those that its publisher still has."""


class GapRepair(Generic[MessageT]):
    """Puts back what was lost before it, ahead of each message that arrives. Used by one thread."""

    def __init__(self, replay: Replay[MessageT]) -> None:
        self._replay = replay
        self._publishers: dict[tuple[str, int], Continuity] = {}

    def complete(self, item: StreamItem[MessageT]) -> Iterator[StreamItem[MessageT]]:
        """Yield what was lost before a message and can be had, then the message; nothing for a double.

        Whatever was published before the subscription counts as lost: it is asked for from number 0 on.
        """
        continuity = self._follow(item.key, item.epoch)
        if item.seq in continuity:
            return
        gaps = continuity.accept(item.seq)
        if gaps:
            for found in self._found(item, gaps):
                if found.seq not in continuity:
                    continuity.accept(found.seq)
                    yield found
        yield item

    def _found(self, item: StreamItem[MessageT], gaps: list[range]) -> list[StreamItem[MessageT]]:
        log = structlog.get_logger("labbus").bind(key=item.key, epoch=item.epoch)
        try:
            found = self._replay(item.key, item.epoch, gaps)
        except (BusError, FaultError) as error:
            log.warning("A gap could not be repaired.", reason=str(error))
            return []
        lost = sum(len(gap) for gap in gaps)
        if len(found) < lost:
            log.warning("A gap could not be repaired as a whole.", lost=lost, replayed=len(found))
        else:
            log.info("A gap was repaired.", replayed=len(found))
        return found

    def _follow(self, key: str, epoch: int) -> Continuity:
        continuity = self._publishers.pop((key, epoch), None) or Continuity()
        # Back to the end: the one that was silent for longest is forgotten first.
        self._publishers[key, epoch] = continuity
        if len(self._publishers) > _FOLLOWED_PUBLISHERS:
            del self._publishers[next(iter(self._publishers))]
        return continuity
