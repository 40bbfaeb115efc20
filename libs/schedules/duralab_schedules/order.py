"""Orders of the repeats of events."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Order(StrEnum):
    """Order of the repeats of a schedule."""

    IN_ORDER = "in_order"
    """All repeats of the first event, then all of the second, and so on."""
    INTERLEAVED = "interleaved"
    """Repeats of each event spread evenly over the whole schedule."""
    SHUFFLED = "shuffled"
    """A random order, from the seed of the schedule."""
    NESTED = "nested"
    """Blocks, each repeated: the events of a block in their order, each with its repeats."""


def in_order(repeats: Sequence[int]) -> NDArray[np.int64]:
    """Return the event of each repeat, one event after the other."""
    return np.repeat(np.arange(len(repeats)), repeats)


def interleaved(repeats: Sequence[int]) -> NDArray[np.int64]:
    """Return the event of each repeat: repeat k of n of an event is at the share (k + 1/2) / n of the schedule."""
    shares = np.concatenate([(2.0 * np.arange(count) + 1.0) / (2.0 * count) for count in repeats if count])
    # Stable: if shares are equal, the events are in their order.
    return in_order(repeats)[np.argsort(shares, kind="stable")]


def shuffled(repeats: Sequence[int], seed: int) -> NDArray[np.int64]:
    """Return the event of each repeat in a random order."""
    return np.random.default_rng(seed).permutation(in_order(repeats))


def nested(blocks: Sequence[tuple[int, Sequence[tuple[int, int]]]]) -> NDArray[np.int64]:
    """Return the event of each repeat from blocks: repeats of the block, and its events with their repeats."""
    return np.concatenate(
        [np.tile(np.repeat(*np.transpose(np.array(events))), times) for times, events in blocks]
    ).astype(np.int64)
