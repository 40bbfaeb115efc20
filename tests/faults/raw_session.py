"""A stranger on the bus: Zenoh and bytes, without the checks that our own client makes before it sends anything."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue

import zenoh

from duralab_proto.v1 import query_pb2

_MEETING_SECONDS = 2.0
_PROGRESS = query_pb2.Progress.DESCRIPTOR.full_name


@dataclass(frozen=True)
class Query:
    """Whatever is asked.

    Parameters
    ----------
    selector : str
        The key.
    payload : bytes or None
        Of the request.
    encoding : str or None
        What it says of itself.
    attachment : bytes or None
        Beside it.
    """

    selector: str
    payload: bytes | None
    encoding: str | None
    attachment: bytes | None = None


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
    silent : bool
        Whether nothing came for too long; else Zenoh itself ended it.
    """

    result: str = ""
    fault: query_pb2.Fault | None = None
    payload: bytes = b""
    silent: bool = False

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
    # As the lab's own sessions: of two links made at the same time one is closed again.
    config.insert_json5(
        "scouting/gossip/autoconnect_strategy", '{"peer": {"to_router": "always", "to_peer": "greater-zid"}}'
    )
    with zenoh.open(config) as session:
        # A new session is not connected to everyone at once: what is sent before is heard by nobody.
        time.sleep(_MEETING_SECONDS)
        yield session


class Stranger:
    """Asks over a session of its own, and over a new one where the old one has lost its link to who serves a key.

    A link that was silent for a lease is closed, as on a machine with ten times as much to do as it has processors. A
    peer of ours is then introduced anew; a stranger is not.

    Parameters
    ----------
    endpoint : str
        Of the lab.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._open = ExitStack()
        self._session = self._open.enter_context(raw_session(endpoint))
        self.sessions = 1
        """How many it took."""

    def close(self) -> None:
        """Leave the bus."""
        self._open.close()

    def ask(self, query: Query, *, served: bool) -> Answer:
        """Ask; where nobody is there though the key is `served`, ask a second time, as one who has just come.

        Who is there and silent is not asked again: that is what is looked for.

        Raises
        ------
        zenoh.ZError
            It cannot be sent.
        """
        answer = ask(self._session, query)
        if answer.none and not answer.silent and served:
            self._open.close()
            self._session = self._open.enter_context(raw_session(self._endpoint))
            self.sessions += 1
            answer = ask(self._session, query)
        return answer


def ask(session: zenoh.Session, query: Query, *, silence_seconds: float = 20.0) -> Answer:
    """Ask whatever bytes and wait for the answer; nothing where there is silence for too long."""
    replies: SimpleQueue[zenoh.Reply | None] = SimpleQueue()
    stop = zenoh.CancellationToken()
    session.get(
        query.selector,
        zenoh.handlers.Callback(replies.put, drop=lambda: replies.put(None), indirect=False),
        payload=query.payload,
        encoding=query.encoding,
        attachment=query.attachment,
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
        return Answer(silent=True)
    finally:
        stop.cancel()
    return answer
