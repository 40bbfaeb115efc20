"""Metrics of the streams of a bus: messages published, received, fetched again, lost and not stored yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from duralab_bus.metrics import NO_LABELS, FigureKind, Labels, Metrics
from duralab_bus.spool import SpoolSpace
from duralab_bus.streams.subscription import Subscription

_BY_MESSAGE = ("message",)


class StreamMetrics:
    """Metrics of the streams of one bus.

    `metrics`: Metrics of its process.
    """

    def __init__(self, metrics: Metrics) -> None:
        self.published = metrics.count(
            "duralab_stream_published_messages_total", "Messages published, by type", labels=_BY_MESSAGE
        )
        self._metrics = metrics

    def follow_spools(self, spaces: Iterable[SpoolSpace], unstored: Callable[[], int]) -> None:
        """Register the metrics of what publishers keep; `spaces` may grow."""
        for name, what, read in (
            ("duralab_stream_unstored_messages", "Messages published that the recorder has not stored yet", unstored),
            ("duralab_spool_bytes", "What spools take", lambda: sum(space.used_bytes for space in spaces)),
            ("duralab_spool_limit_bytes", "What spools may take", lambda: sum(space.largest_bytes for space in spaces)),
        ):
            self._metrics.follow(name, what, lambda read=read: {NO_LABELS: float(read())})

    def follow_subscriptions(self, subscriptions: Iterable[Subscription[Any]]) -> None:
        """Register the metrics of what is received; `subscriptions` may grow, and closed ones leave it."""
        counters: tuple[tuple[str, str, Callable[[Subscription[Any]], int]], ...] = (
            ("received", "Messages handed to their receivers", lambda each: each.received),
            ("fetched", "Messages that were lost on the way and fetched again", lambda each: each.fetched),
            ("lost", "Messages that nobody has any more or that were refused", lambda each: each.lost),
        )
        for name, what, read in counters:
            self._metrics.follow(
                f"duralab_stream_{name}_messages_total",
                f"{what}, by type",
                lambda read=read: _by_message(subscriptions, read),
                labels=_BY_MESSAGE,
                kind=FigureKind.COUNTER,
            )
        self._metrics.follow(
            "duralab_stream_missing_messages",
            "Messages published that are not here yet, by type",
            lambda: _by_message(subscriptions, lambda each: each.missing),
            labels=_BY_MESSAGE,
        )


def _by_message(
    subscriptions: Iterable[Subscription[Any]], read: Callable[[Subscription[Any]], int]
) -> Mapping[Labels, float]:
    counted: Counter[Labels] = Counter()
    for each in list(subscriptions):
        counted[each.message,] += read(each)
    return counted
