"""The bus as a service or a lab script uses it: joining, and all operations of a session."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, Final, Self

import structlog
import zenoh
from google.protobuf.message import Message

from duralab_bus.encoding import MessageT
from duralab_bus.faults import BusError, FaultError
from duralab_bus.metrics import NO_LABELS, Counter, FigureKind, HealthService, Labels, Metrics
from duralab_bus.queries import Cancel, Handler, QueryClient, QueryServer, Served
from duralab_bus.security import Permission
from duralab_bus.session import (
    BusConfig,
    BusSession,
    Declaration,
    Identity,
    Instance,
    LivelinessTracker,
    Reintroduction,
    check_identity,
    open_session,
)
from duralab_bus.spool import SPOOL_BYTES, SpoolFolder, SpoolSpace
from duralab_bus.streams import ReplayClient, ReplayServer, StreamItem, StreamPublisher, Subscription
from duralab_bus.threads import close_at_exit, closed
from duralab_proto.access import Operation
from duralab_proto.keys import ANY, MAIN_INSTANCE, Keys
from duralab_proto.v1 import health_pb2, query_pb2

_STORING: Final = ("recorder", MAIN_INSTANCE)


class LiveToken:
    """Liveliness token and health query of a service instance, until `close` or the end of the process."""

    def __init__(self, token: Declaration[Any], answering: Served, *, on_close: Callable[[LiveToken], None]) -> None:
        self._token = token
        self._answering = answering
        self._on_close = on_close
        self._closed = False

    def close(self) -> None:
        """Withdraw the token and stop the answers to health queries."""
        if not self._closed:
            self._closed = True
            self._token.undeclare()
            self._answering.close()
            self._on_close(self)


class Bus:
    """Session on the bus; made by `open_bus`, closed by `close` or at the end of `with`. Safe for threads."""

    def __init__(
        self,
        session: zenoh.Session,
        config: BusConfig,
        *,
        service: str,
        workers: int,
        listening: tuple[str, ...],
        identity: Identity | None = None,
    ) -> None:
        self.config = config
        self.keys = Keys(config.lab)
        self.service = service
        self.listening = listening
        """Endpoints that others may connect to, with their actual ports."""
        self._session = BusSession(session, config)
        self._limit = config.largest_payload_bytes
        self._tracker = LivelinessTracker(self._session, self.keys)
        self._reintroduction = Reintroduction(config, self._tracker)
        self._permission = Permission(identity, self.keys)
        self.member = self._permission.member
        """Member of the secured lab that the session's certificate names; None without a certificate."""
        self._client = QueryClient(self._session, self.keys, self._tracker, largest_bytes=self._limit)
        self.metrics = Metrics()
        """Metrics of this process: served to Prometheus and in the answer to a health query."""
        self._server = QueryServer(
            self._session, self.keys, service=service, workers=workers, largest_bytes=self._limit, metrics=self.metrics
        )
        self._replays = ReplayServer(self._session)
        self._replay_client = ReplayClient(self._session, largest_bytes=self._limit)
        # Open objects. Sets: adding and discarding are atomic, on any thread that closes an object.
        self._tokens: set[LiveToken] = set()
        self._subscriptions: set[Subscription[Any]] = set()
        self._spaces: set[SpoolSpace] = set()
        self._published = self._follow_streams()
        self._health = HealthService(self.metrics)
        self._closing = threading.Lock()
        self._closed = False
        close_at_exit(self)

    def _follow_streams(self) -> Counter:
        """Register the metrics of the streams; return the counter of published messages, by type."""
        for name, what, read in (
            (
                "duralab_stream_unstored_messages",
                "Messages published that the recorder has not stored yet",
                lambda: self._replays.unstored,
            ),
            ("duralab_spool_bytes", "Size of the spools", lambda: sum(space.used_bytes for space in self._spaces)),
            (
                "duralab_spool_limit_bytes",
                "Largest size of the spools",
                lambda: sum(space.largest_bytes for space in self._spaces),
            ),
        ):
            self.metrics.follow(name, what, lambda read=read: {NO_LABELS: float(read())})
        for name, what, attribute in (
            ("received_messages_total", "Messages handed to their receivers", "received"),
            ("fetched_messages_total", "Messages that were lost on the way and fetched again", "fetched"),
            ("lost_messages_total", "Messages that no publisher has any more or that were refused", "lost"),
            ("missing_messages", "Messages published that are not here yet", "missing"),
        ):
            self.metrics.follow(
                f"duralab_stream_{name}",
                f"{what}, by type",
                lambda attribute=attribute: _by_message(self._subscriptions, attribute),
                labels=_BY_MESSAGE,
                kind=FigureKind.GAUGE if attribute == "missing" else FigureKind.COUNTER,
            )
        return self.metrics.count(
            "duralab_stream_published_messages_total", "Messages published, by type", labels=_BY_MESSAGE
        )

    def serve(
        self,
        key_expression: str,
        request_type: type[MessageT],
        handler: Handler[MessageT],
        *,
        workers: int | None = None,
    ) -> Served:
        """Answer the queries on a key expression; if two match a query, the more specific one answers.

        The handler is called with (request, call) on a worker thread, once per query; a message that is not a
        `request_type` is refused before. It returns the response or raises FaultError. An ArrayError of the request's
        arrays and a KeyNameError of a name become INVALID_ARGUMENT; any other exception is logged and becomes INTERNAL.
        While it runs, the client receives its progress once a second.

        A key has as many workers as the bus was opened with. With `workers`, queries wait for a worker without limit
        and are never refused as BUSY: for requests that must be answered, such as a stop.
        """
        self._permission.expect(Operation.SERVE, key_expression)
        return self._server.serve(key_expression, request_type, handler, workers=workers)

    def query(
        self,
        key: str,
        request: Message,
        response_type: type[MessageT],
        *,
        silence_seconds: float = 10.0,
        longest_seconds: float | None = None,
        on_progress: Callable[[query_pb2.Progress], None] | None = None,
        cancel: Cancel | None = None,
    ) -> MessageT:
        """Send a query to a service and wait for its answer; progress is reported on this thread.

        A service gives a sign of life every second. The wait ends after `silence_seconds` without one, when `cancel`
        is set (such as a `threading.Event`), or after `longest_seconds`, also if there are signs of life. The service
        is notified, but may still finish. The default longest time is a minute for a read from memory, 6 h for another
        read, 30 days for a change or a stop (`duralab_proto.access.longest_seconds_of`). Zenoh holds 0.8 kB of a query
        until that time is over: give a short one to a change that is sent often.

        Raises `FaultError` PERMISSION_DENIED when this member may not send the query, UNAVAILABLE when the service is
        missing or vanishes, DEADLINE_EXCEEDED when it is silent or works beyond the longest time (then with
        `longest_seconds` as its field), CANCELLED on `cancel`, UNIMPLEMENTED when it does not serve the key, DATA_LOSS
        when it ends without a result or with a wrong message, and the fault of its answer. UNAVAILABLE also if the
        connection was lost or is younger than 1.5 s and the query ended without a result: the sentence names the router
        and states whether the request may have arrived. A read (`duralab_proto.access.Effect`) is then sent again, for
        at most 3 s and not beyond its silence; a query that moves or changes something is never sent again. Raises
        `BusError` if this bus is closed, `ValueError` if the longest time is not from 0 to 30 days.
        """
        self._permission.expect(Operation.ASK, key)
        session = self._session.current
        try:
            return self._client.query(
                key,
                request,
                response_type,
                silence_seconds=silence_seconds,
                longest_seconds=longest_seconds,
                on_progress=on_progress,
                cancel=cancel,
            )
        except zenoh.ZError as error:
            self._session.expect_router(key, session)
            raise BusError(f"The query on {key} has no answer: this bus is closed ({error}).") from error

    def publisher(self, key: str, *, spools: SpoolSpace | None = None, durable: bool = False) -> StreamPublisher:
        """Return a publisher on one key, with its own epoch.

        `spools` keep the stream for replay, in 64 MiB of memory if omitted; in a SpoolFolder it survives this process.
        `durable` keeps every message until the recorder acknowledges it, if this session has ever met a recorder: see
        `StreamPublisher.shortage`. Every stream is kept in this way from its first acknowledgement.
        """
        self._permission.expect(Operation.PUBLISH, key)
        if spools is not None:
            self._spaces.add(spools)
        return StreamPublisher(
            self._session,
            key,
            replays=self._replays,
            # A stream without a subscriber that acknowledges takes an eighth of a space.
            spools=spools or SpoolSpace(8 * SPOOL_BYTES),
            held=durable and self._tracker.met(_STORING),
            largest_bytes=self._limit,
            published=self._published,
        )

    def serve_left_spools(self, spools: SpoolFolder) -> int:
        """Offer the streams that dead publishers left in a folder, until acknowledged; return their number."""
        self._spaces.add(spools)
        left = spools.take_over()
        for key, epoch, spool in left:
            self._replays.offer(key=key, epoch=epoch, spool=spool).retire()
        return len(left)

    def subscribe(
        self,
        key_expression: str,
        message_type: type[MessageT],
        callback: Callable[[StreamItem[MessageT]], None],
        on_problem: Callable[[FaultError], None] | None = None,
        *,
        repair: bool = False,
    ) -> Subscription[MessageT]:
        """Receive the messages that are published on a key expression.

        The callback gets each StreamItem, never two at once. It may be slow: up to 8192 messages wait, beyond that the
        oldest are dropped, and with `repair` fetched again when there is room. `on_problem` gets the FaultError of each
        message that is not as expected, never while the callback runs; without it the fault is logged. With `repair`
        the publisher is asked once more for such a message; if that cannot be read either, it is lost and skipped.

        `repair` delivers all messages that publishers of these keys still keep, also of streams that have ended, and
        all that follow: each message once and in order. Messages lost in transit are fetched from the publishers'
        spools; a message that no process on the bus has is skipped after 2 s, and delivered late if it appears. Without
        `repair`, messages may be lost.
        """
        self._permission.expect(Operation.RECEIVE, key_expression)
        subscription = Subscription(
            self._session,
            key_expression,
            message_type,
            callback,
            on_problem=on_problem,
            largest_bytes=self._limit,
            client=self._replay_client if repair else None,
            on_close=self._subscriptions.discard,
        )
        self._subscriptions.add(subscription)
        return subscription

    def declare_live(self, service: str, instance: str) -> LiveToken:
        """Declare an instance of a service live and answer for its health; call it last, when the service answers."""
        if self._tracker.live(service, instance):
            structlog.get_logger("duralab_bus").warning(
                "Another one is on the bus.", service=service, instance=instance
            )
        answering = self.serve(
            self.keys.health(service, instance),
            health_pb2.HealthRequest,
            lambda _request, _call: self._health.report(service, instance),
        )
        key = self.keys.live(service, instance)
        declared = self._session.declare(lambda joined: joined.liveliness().declare_token(key))
        token = LiveToken(declared, answering, on_close=self._tokens.discard)
        self._tokens.add(token)
        return token

    def live(self, service: str = ANY, instance: str = ANY) -> set[Instance]:
        """Return the live services as (service, instance); a new session may not have met all: see `discover`."""
        return self._tracker.live(service, instance)

    def discover(self, service: str = ANY, instance: str = ANY) -> set[Instance]:
        """Return the live services as `live` does, but wait until this session has discovered all of them."""
        self._client.wait_until_discovered()
        return self._tracker.live(service, instance)

    def wait_for_live(self, instances: set[Instance], timeout_seconds: float) -> None:
        """Wait until all instances are live; raise `FaultError` UNAVAILABLE with the missing ones after the timeout."""
        missing = self._tracker.wait_for(set(instances), timeout_seconds=timeout_seconds)
        if missing:
            names = ", ".join(sorted(f"{service}/{instance}" for service, instance in missing))
            raise FaultError(
                query_pb2.FAULT_CODE_UNAVAILABLE,
                f"Not on the bus after {timeout_seconds:g} s: {names}; see whether it runs and what its log says.",
            )

    def stop_serving(self) -> None:
        """Withdraw the liveliness tokens, take no more queries, notify the running handlers and wait briefly for them.

        The client and the publishers still work, so that a service can finish its own work.
        """
        for token in list(self._tokens):
            token.close()
        self._server.close()

    def close(self) -> None:
        """Leave the bus: tokens first, then queries, streams and the session. Returns within about 3 s."""
        with self._closing:
            if self._closed:
                return
            self._closed = True
        closed(self)
        self.stop_serving()
        for subscription in list(self._subscriptions):
            subscription.close()
        self._replays.close()
        for space in self._spaces:
            space.close()
        self._reintroduction.close()
        self._tracker.close()
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_bus(config: BusConfig | None = None, *, service: str, workers: int = 4) -> Bus:
    """Join the bus.

    Parameters
    ----------
    config : BusConfig, optional
        Settings of the session; an unconnected peer on loopback if omitted.
    service : str
        Name of the joining process, e.g. "rig_sim"; named in the faults it answers.
    workers : int
        Number of queries of one key that are answered at once, 1 or more.

    Returns
    -------
    Bus
        Open bus; the caller closes it.

    Raises
    ------
    BusError
        A port is in use, nothing listens at an endpoint of `connect`, or the session is refused.
    """
    config = config or BusConfig()
    identity = check_identity(config.tls) if config.tls is not None else None
    session, listening = open_session(config)
    return Bus(session, config, service=service, workers=workers, listening=listening, identity=identity)


_BY_MESSAGE = ("message",)


def _by_message(subscriptions: Iterable[Subscription[Any]], attribute: str) -> Mapping[Labels, float]:
    counted: defaultdict[Labels, float] = defaultdict(float)
    for each in list(subscriptions):
        counted[each.message,] += getattr(each, attribute)
    return counted
