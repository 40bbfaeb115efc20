"""Metrics of the streams of a bus: messages published, received, fetched again, lost and not stored yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from duralab_bus.metrics import NO_LABELS, FigureKind, Labels, Metrics
from duralab_bus.metrics import Counter as CounterOfMessages
from duralab_bus.spool import SpoolSpace
from duralab_bus.streams.subscription import Subscription

_BY_MESSAGE = ("message",)


def follow_streams(
    metrics: Metrics,
    *,
    spaces: Iterable[SpoolSpace],
    unstored: Callable[[], int],
    subscriptions: Iterable[Subscription[Any]],
) -> CounterOfMessages:
    """Register the metrics of the streams of one bus; return the counter of what it publishes, by type.

    `spaces` and `subscriptions` may grow; closed subscriptions leave it.
    """
    for name, what, read in (
        ("duralab_stream_unstored_messages", "Messages published that the recorder has not stored yet", unstored),
        ("duralab_spool_bytes", "What spools take", lambda: sum(space.used_bytes for space in spaces)),
        ("duralab_spool_limit_bytes", "What spools may take", lambda: sum(space.largest_bytes for space in spaces)),
    ):
        metrics.follow(name, what, lambda read=read: {NO_LABELS: float(read())})
    for name, what, attribute in (
        ("received_messages_total", "Messages handed to their receivers", "received"),
        ("fetched_messages_total", "Messages that were lost on the way and fetched again", "fetched"),
        ("lost_messages_total", "Messages that nobody has any more or that were refused", "lost"),
        ("missing_messages", "Messages published that are not here yet", "missing"),
    ):
        metrics.follow(
            f"duralab_stream_{name}",
            f"{what}, by type",
            lambda attribute=attribute: _by_message(subscriptions, attribute),
            labels=_BY_MESSAGE,
            kind=FigureKind.GAUGE if attribute == "missing" else FigureKind.COUNTER,
        )
    return metrics.count("duralab_stream_published_messages_total", "Messages published, by type", labels=_BY_MESSAGE)


def _by_message(subscriptions: Iterable[Subscription[Any]], attribute: str) -> Mapping[Labels, float]:
    counted: Counter[Labels] = Counter()
    for each in list(subscriptions):
        counted[each.message,] += getattr(each, attribute)
    return counted
