"""Streams: publishing, receiving, replay of lost messages, and the metrics of all that."""

from labbus.streams.continuity import Continuity
from labbus.streams.item import StreamItem
from labbus.streams.metrics import StreamMetrics
from labbus.streams.order import StreamProof
from labbus.streams.publisher import StreamPublisher
from labbus.streams.replay import ReplayServer
from labbus.streams.replay_client import ReplayClient
from labbus.streams.subscription import Subscription

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
