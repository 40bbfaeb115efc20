"""The asking side of a bus: one query from its key to its result or fault, never without an end."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final, Protocol, cast

import zenoh
from google.protobuf.message import Message

from duralab_proto.keys import Keys, parse_live, serving
from duralab_proto.v1 import query_pb2
from labbus._asking_tokens import AskingToken, AskingTokens
from labbus._encoding import MessageT, decode, encode, encoding_of
from labbus._faults import FaultError
from labbus._liveliness import DEBOUNCE_SECONDS, Instance, LivelinessTracker
from labbus._rejoining import BusSession

DISCOVERY_SECONDS: Final = 1.5
"""A session this young may not have met everyone; it waits so long before it says that somebody is not there."""

INTRODUCTION_SECONDS: Final = 0.5
"""Who was never met may be on the way: two that a third has met are introduced to each other a moment later, up to
some tenths of a second on a busy machine. So long a query waits for a stranger, however old its session is."""

# Zenoh ends a query by itself after 10 s otherwise. A durability test in real time takes days; the silence timeout and
# the liveliness token end a query that leads nowhere long before.
_ZENOH_TIMEOUT_SECONDS: Final = 30 * 24 * 3600.0
_POLL_SECONDS: Final = 0.05


class Cancel(Protocol):
    """Says whether a wait is to end; a `threading.Event` is one."""

    def is_set(self) -> bool:
        """Return True once nobody waits any more."""
        ...


class _Gone:
    """The service's liveliness token vanished."""


class _Ended:
    """Zenoh ended the query: no more replies."""


_Event = zenoh.Reply | _Gone | _Ended


class QueryClient:
    """Asks over one session."""

    def __init__(self, session: BusSession, keys: Keys, tracker: LivelinessTracker, *, largest_bytes: int) -> None:
        self._session = session
        self._keys = keys
        self._tracker = tracker
        self._tokens = AskingTokens(keys)
        self._largest_bytes = largest_bytes

    def query(
        self,
        key: str,
        request: Message,
        response_type: type[MessageT],
        *,
        silence_seconds: float,
        on_progress: Callable[[query_pb2.Progress], None] | None,
        cancel: Cancel | None,
    ) -> MessageT:
        """Ask and wait for the answer; see `Bus.query`."""
        if "*" in key:
            raise ValueError(f"The key {key!r} has wildcards; a query goes to one key.")
        instance = parse_live(serving(key))
        payload = encode(request, largest_bytes=self._largest_bytes)
        self._session.expect_router(key)
        self._expect_live(instance)
        events: SimpleQueue[_Event] = SimpleQueue()

        def on_live(service: str, name: str, alive: bool) -> None:
            if not alive and (service, name) == instance:
                events.put(_Gone())

        stop = zenoh.CancellationToken()
        session = self._session.current
        with self._tokens.held(session) as token:
            self._tracker.subscribe(on_live)
            try:
                # Not through a declared querier: of four declared at once on one key, three ended without an answer.
                session.get(
                    key,
                    zenoh.handlers.Callback(events.put, drop=lambda: events.put(_Ended()), indirect=False),
                    payload=payload,
                    encoding=encoding_of(request),
                    attachment=token.asker,
                    source_info=self._tracker.source,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    # Said for the replies as well, which follow the query: no answer is dropped on a busy link.
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    timeout=_ZENOH_TIMEOUT_SECONDS,
                    cancellation_token=stop,
                )
                return self._follow(
                    events,
                    token,
                    key=key,
                    instance=instance,
                    response_type=response_type,
                    silence_seconds=silence_seconds,
                    on_progress=on_progress,
                    cancel=cancel,
                )
            finally:
                self._tracker.unsubscribe(on_live)
                stop.cancel()

    def wait_until_discovered(self) -> None:
        """Wait until the session is old enough to have met everyone."""
        time.sleep(self._undiscovered_seconds)

    @property
    def _undiscovered_seconds(self) -> float:
        return max(0.0, self._session.opened + DISCOVERY_SECONDS - time.monotonic())

    def _follow(
        self,
        events: SimpleQueue[_Event],
        token: AskingToken,
        *,
        key: str,
        instance: Instance,
        response_type: type[MessageT],
        silence_seconds: float,
        on_progress: Callable[[query_pb2.Progress], None] | None,
        cancel: Cancel | None,
    ) -> MessageT:
        deadline = time.monotonic() + silence_seconds
        while True:
            if cancel is not None and cancel.is_set():
                raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"The query on {key} was cancelled.")
            left = deadline - time.monotonic()
            try:
                event = events.get(timeout=max(0.0, left if cancel is None else min(left, _POLL_SECONDS)))
            except Empty:
                if time.monotonic() < deadline:
                    continue
                raise FaultError(
                    query_pb2.FAULT_CODE_DEADLINE_EXCEEDED,
                    f"{_named(instance)} was silent for {silence_seconds:g} s on {key}; "
                    "it hangs, or its machine is overloaded.",
                ) from None
            match event:
                case _Gone():
                    raise self._vanished(key, instance)
                case _Ended():
                    raise self._ended(key, instance)
                case _:
                    token.answered = not _is_progress(event)
                    result = self._read(event, response_type, on_progress)
                    if result is not None:
                        return result
            deadline = time.monotonic() + silence_seconds

    def _read(
        self,
        reply: zenoh.Reply,
        response_type: type[MessageT],
        on_progress: Callable[[query_pb2.Progress], None] | None,
    ) -> MessageT | None:
        """Return the result, or None after progress; raise the service's fault."""
        # A damaged answer is not the asker's fault: not INVALID_ARGUMENT.
        code = query_pb2.FAULT_CODE_DATA_LOSS
        limit = self._largest_bytes
        if (error := reply.err) is not None:
            raise FaultError.from_message(
                decode(error.payload, error.encoding, query_pb2.Fault, largest_bytes=limit, code=code)
            )
        sample = reply.ok
        if sample is None:
            return None
        if not _is_progress(reply):
            return decode(sample.payload, sample.encoding, response_type, largest_bytes=limit, code=code)
        progress = decode(sample.payload, sample.encoding, query_pb2.Progress, largest_bytes=limit, code=code)
        if on_progress is not None:
            on_progress(progress)
        return None

    def _expect_live(self, instance: Instance) -> None:
        # Who was met and is gone is gone.
        patience = 0.0 if self._tracker.met(instance) else INTRODUCTION_SECONDS
        if not self._tracker.wait_for({instance}, timeout_seconds=max(patience, self._undiscovered_seconds)):
            return
        service = instance[0]
        if service == "rig_sim":
            rigs = sorted(rig for _, rig in self._tracker.live(service))
            there = f"the rigs on it: {', '.join(map(repr, rigs))}" if rigs else "there is no rig, start one first"
            raise _unavailable(f"No rig {instance[1]!r} is on the bus of lab {self._keys.lab!r}; {there}.")
        there = sorted({f"{s}/{i}" for s, i in self._tracker.live()})
        raise _unavailable(
            f"No {service} is on the bus of lab {self._keys.lab!r}, "
            f"live are {', '.join(there) or 'none'}; start it first."
        )

    def _ended(self, key: str, instance: Instance) -> FaultError:
        """Return why a query ended without a result: Zenoh itself does not tell a killed service from a missing one."""
        if self._tracker.wait_gone(instance, timeout_seconds=2 * DEBOUNCE_SECONDS):
            return self._vanished(key, instance)
        if not self._is_served(key):
            return FaultError(
                query_pb2.FAULT_CODE_UNIMPLEMENTED, f"{_named(instance)} is on the bus but does not answer {key}."
            )
        return FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"{_named(instance)} ended the query on {key} without a result; its log says more.",
        )

    def _is_served(self, key: str) -> bool:
        with self._session.current.declare_querier(key) as querier:
            # The stub of Zenoh 1.10.2 says bool; it is a MatchingStatus.
            return cast(zenoh.MatchingStatus, querier.matching_status).matching

    @staticmethod
    def _vanished(key: str, instance: Instance) -> FaultError:
        return _unavailable(
            f"{_named(instance)} left the bus before it answered {key}; it ended, crashed or is frozen: see its log."
        )


def _is_progress(reply: zenoh.Reply) -> bool:
    sample = reply.ok
    return sample is not None and str(sample.encoding) == encoding_of(query_pb2.Progress)


def _named(instance: Instance) -> str:
    service, name = instance
    return f"The rig {name!r}" if service == "rig_sim" else f"The {service}"


def _unavailable(message: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, message)
