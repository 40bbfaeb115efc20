"""Logging what was refused, and to whom, without a flood of refusals becoming a flood of lines."""

from __future__ import annotations

import threading
import time
from typing import Final

import structlog
import zenoh

from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2

MOST_PER_SECOND: Final = 20
"""Lines a second; of more, only the number is told with the next line."""

# How a query ended that nobody refused: its asker let go, this process ends, or has a defect, which is logged as such.
_NOT_REFUSED: Final = frozenset(
    {query_pb2.FAULT_CODE_CANCELLED, query_pb2.FAULT_CODE_UNAVAILABLE, query_pb2.FAULT_CODE_INTERNAL}
)
_LONGEST_KEY: Final = 300


def session_of(query: zenoh.Query) -> str:
    """Return the id of the session that asks, as it says itself; the router's log knows its certificate."""
    source = query.source_info
    return "" if source is None else str(source.source_id.zid)


class RefusalLog:
    """Writes a line for each query that is refused, up to a rate."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._second = 0
        self._written = 0
        self._left_out = 0
        self._log = structlog.get_logger("duralab_bus")

    def report(self, key: str, fault: FaultError, *, session: str, asker: str) -> None:
        """Log a refusal: what, why, and who as far as the query says."""
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
