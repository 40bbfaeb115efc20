"""Pieces of received data that are drawn together: drawing 100 samples at a time costs the viewer ten times as much."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, Generic, TypeVar

PIECE_SECONDS: Final = 0.5
"""Longest wait of data to be drawn, in wall-clock seconds: a simulated rig plays two minutes in this time."""

ItemT = TypeVar("ItemT")


class Piece(Generic[ItemT]):
    """Items since the last piece was drawn.

    `clock`: Returns the time in s; it never goes backwards.
    """

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._items: list[ItemT] = []
        self._begun = 0.0

    @property
    def first(self) -> ItemT | None:
        """First item, or None."""
        return self._items[0] if self._items else None

    @property
    def last(self) -> ItemT | None:
        """Last item, or None."""
        return self._items[-1] if self._items else None

    @property
    def due(self) -> bool:
        """Whether the first item has waited for the longest allowed time."""
        return bool(self._items) and self._clock() - self._begun >= PIECE_SECONDS

    def add(self, item: ItemT) -> None:
        """Add an item."""
        if not self._items:
            self._begun = self._clock()
        self._items.append(item)

    def take(self) -> list[ItemT]:
        """Return all items and start the next piece."""
        items, self._items = self._items, []
        return items
