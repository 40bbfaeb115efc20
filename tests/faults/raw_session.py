"""A stranger on the bus: Zenoh and bytes, without the checks that our own client makes before it sends anything."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue

import zenoh

from duralab_proto.v1 import query_pb2

_MEETING_SECONDS = 2.0
_PROGRESS = query_pb2.Progress.DESCRIPTOR.full_name


@dataclass(frozen=True)
class Answer:
    """How a query ended: with a result, a fault, or neither.

    Parameters
    ----------
    result : str
        Full name of the answer's message; empty where there is none.
    fault : Fault or None
        What was refused.
    payload : bytes
        Of the result.
    """

    result: str = ""
    fault: query_pb2.Fault | None = None
    payload: bytes = b""

    @property
    def none(self) -> bool:
        """Whether it ended without a word."""
        return not self.result and self.fault is None


@contextmanager
def raw_session(endpoint: str) -> Iterator[zenoh.Session]:
    """Open a session at an endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        # A new session is not connected to everyone at once: what is sent before is heard by nobody.
        time.sleep(_MEETING_SECONDS)
        yield session


def ask(
    session: zenoh.Session,
    selector: str,
    payload: bytes | None,
    *,
    encoding: str | None,
    attachment: bytes | None = None,
    silence_seconds: float = 20.0,
) -> Answer:
    """Ask whatever bytes and wait for the answer; nothing where there is silence for too long."""
    replies: SimpleQueue[zenoh.Reply | None] = SimpleQueue()
    stop = zenoh.CancellationToken()
    session.get(
        selector,
        zenoh.handlers.Callback(replies.put, drop=lambda: replies.put(None), indirect=False),
        payload=payload,
        encoding=encoding,
        attachment=attachment,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=3600.0,
        cancellation_token=stop,
    )
    answer = Answer()
    try:
        while (reply := replies.get(timeout=silence_seconds)) is not None:
            if reply.ok is None:
                assert reply.err is not None
                answer = Answer(fault=query_pb2.Fault.FromString(reply.err.payload.to_bytes()))
                continue
            kind = str(reply.ok.encoding).partition(";")[2]
            if kind != _PROGRESS:
                answer = Answer(result=kind or "?", payload=reply.ok.payload.to_bytes())
    except Empty:
        return Answer()
    finally:
        stop.cancel()
    return answer
