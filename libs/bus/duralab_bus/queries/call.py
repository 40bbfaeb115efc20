"""One query on the server's side: from its arrival to its one answer, or to a line in the log that refuses it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Final, Generic

import structlog
import zenoh
from google.protobuf.message import Message

from duralab_bus.encoding import MessageT, decode, encode, encoding_of
from duralab_bus.faults import FaultError
from duralab_bus.tracing import SpanKind, span
from duralab_proto.arrays import ArrayError
from duralab_proto.keys import LONGEST_NAME, KeyNameError, rig_of
from duralab_proto.v1 import query_pb2

MOST_PER_SECOND: Final = 20
"""Largest number of lines a second; the number of those left out is logged with the next line."""

# Ends that are not refusals: the client withdrew, this process ends, or it has a defect, which is logged separately.
_NOT_REFUSED: Final = frozenset(
    {query_pb2.FAULT_CODE_CANCELLED, query_pb2.FAULT_CODE_UNAVAILABLE, query_pb2.FAULT_CODE_INTERNAL}
)
_LONGEST_KEY: Final = 300


def session_of(query: zenoh.Query) -> str:
    """Return the id of the asking session, as the session states it; the router's log has its certificate."""
    source = query.source_info
    return "" if source is None else str(source.source_id.zid)


class RefusalLog:
    """Log with one line for each refused query, up to a rate."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._second = 0
        self._written = 0
        self._left_out = 0
        self._log = structlog.get_logger("duralab_bus")

    def report(self, key: str, fault: FaultError, *, session: str, asker: str) -> None:
        """Log a refused query: its key, the reason, and the client as far as the query names it."""
        if fault.code in _NOT_REFUSED:
            return
        with self._lock:
            second = int(time.monotonic())
            if second != self._second:
                self._second, self._written = second, 0
            if self._written >= MOST_PER_SECOND:
                self._left_out += 1
                return
            self._written += 1
            left_out, self._left_out = self._left_out, 0
        self._log.warning(
            "A query is refused.",
            key=key[:_LONGEST_KEY],
            code=fault.code_name,
            reason=fault.to_message().message,
            session=session,
            asker=asker[:_LONGEST_KEY],
            **({"others_left_out": left_out} if left_out else {}),
        )


KEEP_ALIVE_SECONDS: Final = 0.8
"""Interval in seconds after which progress is sent again, so that a client gets it at least once a second."""

_SHORTEST_PROGRESS_SECONDS: Final = 0.05

Handler = Callable[[MessageT, "Call"], Message]


class Call:
    """Context of a handler beside the request; made by the bus for each query."""

    def __init__(self, key: str, *, send: Callable[[query_pb2.Progress], None], cancelled: threading.Event) -> None:
        self.key = key
        """Key of the query, without wildcards."""
        self._send = send
        self._cancelled = cancelled

    @property
    def cancelled(self) -> bool:
        """Whether the answer is no longer wanted: the client ended or stopped waiting, or this bus closes.

        Set 0.3 s after the client withdrew; never for a client that sends no id with its query.
        """
        return self._cancelled.is_set()

    def require_rig(self, rig: str, *, field: str) -> None:
        """Raise FaultError unless a request is about the rig in its key: access control checks only the key."""
        if rig != (named := rig_of(self.key)):
            raise FaultError(
                query_pb2.FAULT_CODE_INVALID_ARGUMENT,
                f"{field} is {rig[:LONGEST_NAME]!r}, but the key {self.key} is that of rig {named!r}; "
                "ask on the key of the rig that is meant.",
                field=field,
            )

    def progress(self, phase: str, fraction: float, *, remaining_seconds: float = -1.0, detail: str = "") -> None:
        """Report progress to the client; at most 20 reports a second are sent, the others are dropped.

        The phase names the present work as text; the time to the result is negative if unknown.
        """
        if not 0.0 <= fraction <= 1.0 or not math.isfinite(remaining_seconds):
            raise ValueError(
                f"Progress of {fraction} with {remaining_seconds} s to go cannot be; "
                "the fraction is 0 to 1 and the time is finite."
            )
        self._send(
            query_pb2.Progress(phase=phase, fraction=fraction, remaining_seconds=remaining_seconds, detail=detail)
        )


class QueryJob(Generic[MessageT]):
    """Query that a worker handles. Worker, ticker and closing may all answer; exactly one answer is sent."""

    def __init__(
        self,
        query: zenoh.Query,
        *,
        request_type: type[MessageT],
        handler: Handler[MessageT],
        service: str,
        largest_bytes: int,
        refusals: RefusalLog,
        on_end: Callable[[QueryJob[MessageT]], None],
    ) -> None:
        self.key = str(query.key_expr)
        self.asker = "" if query.attachment is None else query.attachment.to_bytes().decode("ascii", "replace")
        self._session = session_of(query)
        self._refusals = refusals
        self._query = query
        self._request_type = request_type
        self._handler = handler
        self._service = service
        self._largest_bytes = largest_bytes
        self._on_end = on_end
        self._lock = threading.Lock()
        self._progress = query_pb2.Progress(remaining_seconds=-1.0)
        self._sent_at = time.monotonic()
        self._answered = False
        self.code = "OK"
        """Result of the query: the name of a fault's code, or OK."""
        self._cancelled = threading.Event()
        self._log = structlog.get_logger("duralab_bus").bind(key=self.key)

    def cancel(self) -> None:
        """Notify the handler that its client has withdrawn."""
        self._cancelled.set()

    def run(self) -> None:
        """Decode the request, call the handler, and answer."""
        try:
            if self._cancelled.is_set():
                raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "The client cancelled before the query began.")
            if "*" in self.key:
                raise FaultError(
                    query_pb2.FAULT_CODE_INVALID_ARGUMENT,
                    f"The key {self.key!r} has wildcards; ask one key at a time, see the liveliness tokens.",
                )
            query = self._query
            request = decode(query.payload, query.encoding, self._request_type, largest_bytes=self._largest_bytes)
            call = Call(self.key, send=self._report, cancelled=self._cancelled)
            with span(self.key, SpanKind.SERVICE):
                response = self._handler(request, call)
            payload = encode(response, largest_bytes=self._largest_bytes, code=query_pb2.FAULT_CODE_INTERNAL)
        except FaultError as fault:
            self.refuse(fault)
        except ArrayError as error:
            # Handlers decode arrays of the request; a wrong array is an error of the client.
            self.refuse(FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=error.field))
        except KeyNameError as error:
            # In the same way names: those in the key of the query, and those from which handlers make keys.
            self.refuse(FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error)))
        except Exception as error:  # noqa: BLE001 - any defect of a handler must reach the client as a fault
            self._log.exception("A query failed by a defect of this service.")
            self.refuse(
                FaultError(
                    query_pb2.FAULT_CODE_INTERNAL,
                    f"The {self._service} failed by a defect of its own ({type(error).__name__}: {error}); "
                    "its log says more.",
                )
            )
        else:
            self._answer(lambda query: query.reply(self.key, payload, encoding=encoding_of(response)))

    def refuse(self, fault: FaultError) -> None:
        """Answer with a fault, unless an answer was sent."""
        message = fault.to_message()
        message.service = message.service or self._service
        payload = message.SerializeToString()
        self._refusals.report(self.key, fault, session=self._session, asker=self.asker)
        self._answer(lambda query: query.reply_err(payload, encoding=encoding_of(message)), code=fault.code_name)

    def keep_alive(self) -> None:
        """Send the last progress again if the client has received nothing for `KEEP_ALIVE_SECONDS`."""
        # Do not wait for a reply that is being sent: that is a sign of life as well.
        if not self._lock.acquire(blocking=False):
            return
        try:
            if time.monotonic() - self._sent_at >= KEEP_ALIVE_SECONDS:
                self._send_progress()
        finally:
            self._lock.release()

    def _report(self, progress: query_pb2.Progress) -> None:
        with self._lock:
            new_phase = progress.phase != self._progress.phase
            self._progress = progress
            if new_phase or time.monotonic() - self._sent_at >= _SHORTEST_PROGRESS_SECONDS:
                self._send_progress()

    def _send_progress(self) -> None:
        """Send the last progress; the lock is held."""
        if self._answered:
            return
        self._sent_at = time.monotonic()
        try:
            self._query.reply(self.key, self._progress.SerializeToString(), encoding=encoding_of(query_pb2.Progress))
        except zenoh.ZError:
            self._log.info("Progress could not be sent; the session is closed.")

    def _answer(self, send: Callable[[zenoh.Query], None], *, code: str = "OK") -> None:
        with self._lock:
            if self._answered:
                return
            self._answered = True
            self.code = code
            try:
                # A query that is not dropped would let the client wait for more.
                with self._query as query:
                    send(query)
            except zenoh.ZError:
                self._log.warning("The answer could not be sent; the session is closed.")
        self._on_end(self)
