"""The client side of a bus: one query from its key to its result or fault, always with an end."""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Final, Generic, Protocol, cast

import structlog
import zenoh
from google.protobuf.message import Message

from duralab_bus.encoding import MessageT, decode, encode, encoding_of
from duralab_bus.faults import FaultError
from duralab_bus.session import DEBOUNCE_SECONDS, BusSession, Instance, LivelinessTracker
from duralab_bus.tracing import SpanKind, span
from duralab_proto.access import WORK_SECONDS, Effect, effect_of, longest_seconds_of
from duralab_proto.keys import Keys, parse_live, serving
from duralab_proto.v1 import query_pb2


@dataclass
class AskingToken:
    """Declared liveliness token, with the random id of its client, which is sent with the query.

    The client sets `answered` when the service has answered the query: then another query may use the token.
    """

    asker: str
    session: zenoh.Session
    token: zenoh.LivelinessToken
    answered: bool = False


class AskingTokens:
    """Tokens of one bus; as many as the largest number of its simultaneous queries. Safe for threads."""

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._lock = threading.Lock()
        self._idle: list[AskingToken] = []

    @contextmanager
    def held(self, session: zenoh.Session) -> Iterator[AskingToken]:
        """Hold a token for a query on a session.

        A token whose query was not answered is undeclared at the end, and its id is never used again: this notifies
        the service that no client waits for the query any more.
        """
        token = self._idle_on(session) or self._declared(session)
        try:
            yield token
        finally:
            if token.answered:
                with self._lock:
                    self._idle.append(token)
            else:
                # A closed session has already dropped its tokens.
                with suppress(zenoh.ZError):
                    token.token.undeclare()

    def _idle_on(self, session: zenoh.Session) -> AskingToken | None:
        with self._lock:
            # Tokens of a session that was replaced were dropped with it.
            self._idle = [token for token in self._idle if token.session is session]
            if not self._idle:
                return None
            token = self._idle.pop()
        token.answered = False
        return token

    def _declared(self, session: zenoh.Session) -> AskingToken:
        asker = secrets.token_hex(16)
        return AskingToken(asker, session, session.liveliness().declare_token(self._keys.asking(asker)))


DISCOVERY_SECONDS: Final = 1.5
"""Age in seconds of a connection that may not have met all members, nor know every key that they serve: only after
this time without a loss is a service reported as missing, or as not serving a key."""

INTRODUCTION_SECONDS: Final = 0.5
"""Longest time in seconds that a query waits for an instance that was never met, on a session of any age: a third
member introduces two members a moment after it met them, up to some tenths of a second on a busy machine."""

AGAIN_SECONDS: Final = 3.0
"""Longest time, in seconds, in which an interrupted read is sent again, and for which a change is held back."""

# Zenoh restores a link within some 50 ms. Each attempt declares a token, and Zenoh never forgets one: few attempts.
_PAUSES_SECONDS: Final = (0.05, 0.1, 0.2, 0.4)
# A router that has been back for longer does not explain a missing service.
_RETURN_SECONDS: Final = 10.0

OVERDUE: Final = (query_pb2.FAULT_CODE_DEADLINE_EXCEEDED, "longest_seconds")
"""Code and field of the fault for a query whose service works on it for longer than `longest_seconds`."""

# Zenoh's answer instead of the service's when the timeout of a query is over.
_ZENOH_TIMEOUT: Final = b"Timeout"
_POLL_SECONDS: Final = 0.05
# If a wait ends this much too late, this process did not run meanwhile. The deadline is then extended by the delay and
# by this time, so that an answer can still be delivered.
_SLEPT_SECONDS: Final = 0.5
# A router reported a served key within 8 ms; without this wait every end was taken for an unserved key.
_MATCHING_SECONDS: Final = 0.5
_MATCHING_POLL_SECONDS: Final = 0.002


class Cancel(Protocol):
    """Source of the request to end a wait, such as a `threading.Event`."""

    def is_set(self) -> bool:
        """Return whether the caller no longer waits."""
        ...


class _Gone:
    """The service's liveliness token vanished."""


class _Ended:
    """Zenoh ended the query: no more replies."""


_Event = zenoh.Reply | _Gone | _Ended


@dataclass
class _Question(Generic[MessageT]):
    """One query: a change is sent once, a read again if a lost connection interrupted it."""

    key: str
    instance: Instance
    payload: bytes
    encoding: str
    response_type: type[MessageT]
    effect: Effect
    silence_seconds: float
    longest_seconds: float
    on_progress: Callable[[query_pb2.Progress], None] | None
    cancel: Cancel | None
    asks: int = 0
    deadline: float = math.inf
    """Time when it was silent for too long, in s of the monotonic clock; another attempt does not extend it, a sign of
    life does."""
    cut_off: float = math.inf
    """Time when it first ended without an answer, on the same clock."""

    def expect_wanted(self) -> None:
        if self.cancel is not None and self.cancel.is_set():
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"The query on {self.key} was cancelled.")

    @property
    def again_until(self) -> float:
        return min(self.deadline, self.cut_off + AGAIN_SECONDS)

    @property
    def pause(self) -> float:
        return _PAUSES_SECONDS[min(self.asks, len(_PAUSES_SECONDS)) - 1]


class QueryClient:
    """Client of the queries that one session sends; a query ends when its service vanishes."""

    def __init__(self, session: BusSession, keys: Keys, tracker: LivelinessTracker, *, largest_bytes: int) -> None:
        self._session = session
        self._keys = keys
        self._tracker = tracker
        self._tokens = AskingTokens(keys)
        self._largest_bytes = largest_bytes
        self._log = structlog.get_logger("duralab_bus")

    def query(
        self,
        key: str,
        request: Message,
        response_type: type[MessageT],
        *,
        silence_seconds: float,
        longest_seconds: float | None,
        on_progress: Callable[[query_pb2.Progress], None] | None,
        cancel: Cancel | None,
    ) -> MessageT:
        """Send a query and wait for the answer; see `Bus.query`."""
        if "*" in key:
            raise ValueError(f"The key {key!r} has wildcards; a query goes to one key.")
        if longest_seconds is not None and not 0.0 < longest_seconds <= WORK_SECONDS:
            raise ValueError(
                f"longest_seconds is {longest_seconds}; it must be greater than 0 and at most {WORK_SECONDS:.0f}; "
                "leave it out for the time of the key."
            )
        question = _Question(
            key=key,
            instance=parse_live(serving(key)),
            payload=encode(request, largest_bytes=self._largest_bytes),
            encoding=encoding_of(request),
            response_type=response_type,
            effect=effect_of(key, self._keys),
            silence_seconds=silence_seconds,
            longest_seconds=longest_seconds or longest_seconds_of(key, self._keys),
            on_progress=on_progress,
            cancel=cancel,
        )
        while True:
            if question.asks and self._session.away:
                raise self._interrupted(question)
            self._session.expect_router(key)
            self._expect_live(question)
            if question.effect is Effect.CHANGE:
                self._expect_way(question)
            with span(f"ask {key}", SpanKind.WAITING):
                answer = self._ask(question)
            if not isinstance(answer, _Gone | _Ended):
                if question.asks > 1:
                    self._log.warning(
                        "A read was asked again: its connection was lost.",
                        key=key,
                        asks=question.asks,
                        seconds=round(time.monotonic() - question.cut_off, 3),
                    )
                return answer
            question.cut_off = min(question.cut_off, time.monotonic())
            self._expect_another_ask(question, gone=isinstance(answer, _Gone))
            time.sleep(question.pause)

    def _ask(self, question: _Question[MessageT]) -> MessageT | _Gone | _Ended:
        """Send a query once and return its answer, or how it ended without one."""
        events: SimpleQueue[_Event] = SimpleQueue()

        def on_live(service: str, name: str, alive: bool) -> None:
            if not alive and (service, name) == question.instance:
                events.put(_Gone())

        stop = zenoh.CancellationToken()
        session = self._session.current
        with self._tokens.held(session) as token:
            self._tracker.subscribe(on_live)
            question.deadline = min(question.deadline, time.monotonic() + question.silence_seconds)
            try:
                # Not through a declared querier: of four declared at once on one key, three ended without an answer.
                session.get(
                    question.key,
                    zenoh.handlers.Callback(events.put, drop=lambda: events.put(_Ended()), indirect=False),
                    payload=question.payload,
                    encoding=question.encoding,
                    attachment=token.asker,
                    source_info=self._tracker.source,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    # Applies also to the replies, which follow the query: no answer is dropped on a busy link.
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    # Zenoh holds 0.8 kB of each query until this time is over, answered or not (decision 34).
                    timeout=question.longest_seconds,
                    cancellation_token=stop,
                )
                question.asks += 1
                return self._follow(events, token, question)
            finally:
                self._tracker.unsubscribe(on_live)
                stop.cancel()

    def wait_until_discovered(self) -> None:
        """Wait until the session is old enough to have met all members."""
        time.sleep(self._undiscovered_seconds)

    @property
    def _undiscovered_seconds(self) -> float:
        return max(0.0, self._session.linked + DISCOVERY_SECONDS - time.monotonic())

    def _follow(
        self, events: SimpleQueue[_Event], token: AskingToken, question: _Question[MessageT]
    ) -> MessageT | _Gone | _Ended:
        while True:
            question.expect_wanted()
            begun = time.monotonic()
            left = question.deadline - begun
            wait = max(0.0, left if question.cancel is None else min(left, _POLL_SECONDS))
            try:
                event = events.get(timeout=wait)
            except Empty:
                # A process that did not run itself, on an overloaded or paused machine, received nothing: the answer
                # may still be delivered.
                if (slept := time.monotonic() - begun - wait) > _SLEPT_SECONDS:
                    question.deadline += slept + _SLEPT_SECONDS
                if time.monotonic() < question.deadline:
                    continue
                if question.asks > 1:
                    raise self._interrupted(question) from None
                raise FaultError(
                    query_pb2.FAULT_CODE_DEADLINE_EXCEEDED,
                    f"{_named(question.instance)} was silent for {question.silence_seconds:g} s on {question.key}; "
                    "it hangs, or its machine is overloaded.",
                ) from None
            if isinstance(event, _Gone | _Ended):
                return event
            if _is_timeout(event):
                raise self._overdue(question)
            token.answered = not _is_progress(event)
            result = self._read(event, question.response_type, question.on_progress)
            if result is not None:
                return result
            question.deadline = time.monotonic() + question.silence_seconds

    def _read(
        self,
        reply: zenoh.Reply,
        response_type: type[MessageT],
        on_progress: Callable[[query_pb2.Progress], None] | None,
    ) -> MessageT | None:
        """Return the result, or None after progress; raise the service's fault."""
        # A damaged answer is not an error of the client: not INVALID_ARGUMENT.
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

    def _expect_live(self, question: _Question[Any]) -> None:
        instance = question.instance
        # An instance that was met and is missing has left: no wait for it.
        patience = 0.0 if self._tracker.met(instance) else INTRODUCTION_SECONDS
        patience = max(patience, self._undiscovered_seconds)
        if question.asks:
            patience = min(patience, max(0.0, question.again_until - time.monotonic()))
        if not self._tracker.wait_for({instance}, timeout_seconds=patience):
            return
        if self._not_back(instance):
            raise _unavailable(
                f"{_named(instance)} has not come back to the bus since {self._session.router} was away, so "
                f"{question.key} has no answer; see that both run, and ask again."
            )
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

    def _not_back(self, instance: Instance) -> bool:
        """Return whether an instance left with a router that was recently away, and was not seen since."""
        recently = self._session.disturbed(time.monotonic() - _RETURN_SECONDS)
        back = self._tracker.moved(instance, self._session.linked + DEBOUNCE_SECONDS)
        return recently and self._tracker.met(instance) and not back

    def _expect_way(self, question: _Question[Any]) -> None:
        """Hold a change until its key is known if the connection was just lost or made: a change is sent only once."""
        until = time.monotonic() + min(AGAIN_SECONDS, question.silence_seconds)
        while self._unsettled(question.instance, time.monotonic() - DISCOVERY_SECONDS):
            question.expect_wanted()
            self._session.expect_router(question.key)
            if self._is_served(question.key, timeout_seconds=_POLL_SECONDS):
                return
            if time.monotonic() >= until:
                raise _unavailable(
                    f"{self._connection(question)}, so nothing was sent on {question.key}; ask again in a moment."
                )

    def _unsettled(self, instance: Instance, since: float) -> bool:
        """Return whether the connection to an instance, direct or over the router, was recently lost or made."""
        return self._session.disturbed(since) or self._tracker.moved(instance, since)

    def _expect_another_ask(self, question: _Question[Any], *, gone: bool) -> None:
        """Raise why a query ended without a result; return if it may be sent again.

        Zenoh itself does not distinguish a killed service from a missing one, nor from a connection that was just
        restored: there a query may end within milliseconds, before the keys of the others are known (its issue 2767).
        """
        ended = time.monotonic()
        instance, since, until = question.instance, ended - DISCOVERY_SECONDS, ended + 2 * DEBOUNCE_SECONDS
        # The loss of the link is reported some tenths of a millisecond after the end of the query.
        while not (gone or self._session.disturbed(since)) and time.monotonic() < until:
            gone = self._tracker.wait_gone(instance, timeout_seconds=_POLL_SECONDS)
        disturbed = self._session.disturbed(since)
        if gone and not disturbed:
            raise _unavailable(
                f"{_named(instance)} left the bus before it answered {question.key}; it ended, crashed or is frozen: "
                "see its log."
            )
        if not self._unsettled(instance, since):
            raise self._unanswered(question)
        if question.effect is Effect.CHANGE or time.monotonic() + question.pause >= question.again_until:
            raise self._interrupted(question)

    def _overdue(self, question: _Question[Any]) -> FaultError:
        """Return the fault of a query on which the service works for longer than allowed."""
        code, field = OVERDUE
        if question.effect is Effect.READ:
            remedy = "see its log for what it waits for, or ask with a longer time"
        else:
            remedy = f"see the state of {_within(question.instance)} before you ask again"
        return FaultError(
            code,
            f"{_named(question.instance)} has not answered {question.key} within {question.longest_seconds:g} s, the "
            f"longest time for this query; {remedy}.",
            field=field,
        )

    def _interrupted(self, question: _Question[Any]) -> FaultError:
        """Return the fault of a query whose connection broke: that to the router, or that of the service."""
        if question.effect is Effect.READ:
            outcome = f"{question.key}, a read, has no answer after being asked {question.asks} times; ask again"
        else:
            outcome = (
                f"it is unknown whether the request on {question.key} arrived, and it is not sent again: see the state "
                f"of {_within(question.instance)} before you ask again"
            )
        return _unavailable(f"{self._connection(question)}: {outcome}.")

    def _connection(self, question: _Question[Any]) -> str:
        # The interruption of the first attempt counts, independent of its age.
        since = min(question.cut_off, time.monotonic()) - DISCOVERY_SECONDS
        if self._session.disturbed(since):
            return f"The connection to {self._session.router} was lost or is just back"
        return f"The connection of {_within(question.instance)} to the bus is just made"

    def _unanswered(self, question: _Question[Any]) -> FaultError:
        """Return why there is no result though the connection is intact."""
        if self._is_served(question.key, timeout_seconds=_MATCHING_SECONDS):
            return FaultError(
                query_pb2.FAULT_CODE_DATA_LOSS,
                f"{_named(question.instance)} ended the query on {question.key} without a result; its log says more.",
            )
        return FaultError(
            query_pb2.FAULT_CODE_UNIMPLEMENTED,
            f"{_named(question.instance)} is on the bus but does not answer {question.key}.",
        )

    def _is_served(self, key: str, *, timeout_seconds: float) -> bool:
        until = time.monotonic() + timeout_seconds
        try:
            with self._session.current.declare_querier(key) as querier:
                # The router reports a key some milliseconds after the request. The stub of Zenoh 1.10.2 declares a
                # bool; it is a MatchingStatus.
                while not (served := cast(zenoh.MatchingStatus, querier.matching_status).matching):
                    if time.monotonic() >= until:
                        break
                    time.sleep(_MATCHING_POLL_SECONDS)
                return served
        except zenoh.ZError:
            if self._session.closed:
                raise
            return False  # Its link is lost.


def _is_progress(reply: zenoh.Reply) -> bool:
    sample = reply.ok
    return sample is not None and str(sample.encoding) == encoding_of(query_pb2.Progress)


def _is_timeout(reply: zenoh.Reply) -> bool:
    error = reply.err
    # Distinguished from a service's error by its encoding as well: that is always a Fault.
    return (
        error is not None
        and error.payload.to_bytes() == _ZENOH_TIMEOUT
        and str(error.encoding) != encoding_of(query_pb2.Fault)
    )


def _named(instance: Instance) -> str:
    service, name = instance
    return f"The rig {name!r}" if service == "rig_sim" else f"The {service}"


def _within(instance: Instance) -> str:
    """Return the name of an instance as written within a sentence."""
    return f"t{_named(instance)[1:]}"


def _unavailable(message: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, message)
