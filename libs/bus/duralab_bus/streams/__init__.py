"""Streams: publishing, receiving and replay of lost messages."""

from duralab_bus.streams.item import StreamItem
from duralab_bus.streams.order import Continuity, StreamProof
from duralab_bus.streams.publisher import StreamPublisher
from duralab_bus.streams.replay import ReplayClient, ReplayServer
from duralab_bus.streams.subscription import Subscription

__all__ = [
    "Continuity",
    "ReplayClient",
    "ReplayServer",
    "StreamItem",
    "StreamProof",
    "StreamPublisher",
    "Subscription",
]
