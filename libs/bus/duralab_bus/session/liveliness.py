"""Members on the bus: the liveliness tokens of the lab, without short interruptions."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final

import zenoh

from duralab_bus.session.rejoining import BusSession
from duralab_bus.threads import BusThread
from duralab_proto.keys import ANY, Keys, parse_live

DEBOUNCE_SECONDS: Final = 0.3
"""Time in seconds for which a missing token still counts as live: links flap."""

Instance = tuple[str, str]
"""(service, instance)"""

LiveCallback = Callable[[str, str, bool], None]


class LivelinessTracker:
    """Tracker of every liveliness token of the lab, including those declared before it."""

    def __init__(self, session: BusSession, keys: Keys) -> None:
        self._changed = threading.Condition()
        self._live: set[Instance] = set()
        self._met: set[Instance] = set()
        self._moved: dict[Instance, float] = {}
        self._listeners: list[LiveCallback] = []
        self._events: SimpleQueue[zenoh.Sample | None] = SimpleQueue()
        BusThread(self._run, name="duralab_bus-liveliness").start()
        # A session that replaces this one reports all present members again.
        self._subscriber = session.declare(
            lambda joined: joined.liveliness().declare_subscriber(
                keys.live(ANY, ANY), zenoh.handlers.Callback(self._events.put, indirect=False), history=True
            )
        )

    @property
    def source(self) -> zenoh.SourceInfo | None:
        """Identity of this session, which its queries carry."""
        subscriber = self._subscriber.current
        return None if subscriber is None else zenoh.SourceInfo(subscriber.id, 0)

    def live(self, service: str = ANY, instance: str = ANY) -> set[Instance]:
        """Return the live instances, of a service and an instance or of any."""
        with self._changed:
            return {(s, i) for s, i in self._live if service in (ANY, s) and instance in (ANY, i)}

    def met(self, instance: Instance) -> bool:
        """Return whether an instance was ever live."""
        with self._changed:
            return instance in self._met

    def moved(self, instance: Instance, since: float) -> bool:
        """Return whether an instance's token came or went after a time of the monotonic clock, flaps included."""
        with self._changed:
            return self._moved.get(instance, -math.inf) >= since

    def wait_for(self, wanted: set[Instance], *, timeout_seconds: float) -> set[Instance]:
        """Wait until all instances are live; return those that are still missing after the timeout."""
        with self._changed:
            self._changed.wait_for(lambda: wanted <= self._live, timeout_seconds)
            return wanted - self._live

    def wait_gone(self, instance: Instance, *, timeout_seconds: float) -> bool:
        """Wait until an instance is not live; return whether it has left."""
        with self._changed:
            return self._changed.wait_for(lambda: instance not in self._live, timeout_seconds)

    def subscribe(self, listener: LiveCallback) -> None:
        """Call a listener for every live instance and at every change; it must return at once."""
        with self._changed:
            self._listeners.append(listener)
            for service, instance in sorted(self._live):
                listener(service, instance, True)

    def unsubscribe(self, listener: LiveCallback) -> None:
        """Remove a listener."""
        with self._changed:
            self._listeners.remove(listener)

    def close(self) -> None:
        """Stop the tracking."""
        self._subscriber.undeclare()
        self._events.put(None)

    def _run(self) -> None:
        leaving: dict[Instance, float] = {}
        while True:
            wait = max(0.0, min(leaving.values()) - time.monotonic()) if leaving else None
            try:
                sample = self._events.get(timeout=wait)
            except Empty:
                now = time.monotonic()
                for instance in [instance for instance, until in leaving.items() if until <= now]:
                    del leaving[instance]
                    self._change(instance, alive=False)
                continue
            if sample is None:
                return
            try:
                instance = parse_live(str(sample.key_expr))
            except ValueError:
                continue  # Token outside the contract.
            with self._changed:
                self._moved[instance] = time.monotonic()
            if sample.kind == zenoh.SampleKind.PUT:
                leaving.pop(instance, None)
                self._change(instance, alive=True)
            else:
                leaving.setdefault(instance, time.monotonic() + DEBOUNCE_SECONDS)

    def _change(self, instance: Instance, *, alive: bool) -> None:
        with self._changed:
            if alive == (instance in self._live):
                return
            if alive:
                self._live.add(instance)
                self._met.add(instance)
            else:
                self._live.remove(instance)
            for listener in self._listeners:
                listener(*instance, alive)
            self._changed.notify_all()
