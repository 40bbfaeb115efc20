"""Streams: publishing, receiving, replay of lost messages, and the metrics of all that."""

from duralab_bus.streams.continuity import Continuity
from duralab_bus.streams.item import StreamItem
from duralab_bus.streams.metrics import StreamMetrics
from duralab_bus.streams.order import StreamProof
from duralab_bus.streams.publisher import StreamPublisher
from duralab_bus.streams.replay import ReplayServer
from duralab_bus.streams.replay_client import ReplayClient
from duralab_bus.streams.subscription import Subscription

__all__ = [
    "Continuity",
    "ReplayClient",
    "ReplayServer",
    "StreamItem",
    "StreamMetrics",
    "StreamProof",
    "StreamPublisher",
    "Subscription",
]
