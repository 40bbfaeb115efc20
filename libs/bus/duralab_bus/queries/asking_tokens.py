"""The tokens that tell a service that its asker still waits: each for one query at a time, and used again.

Zenoh 1.10.2 keeps what it knows of a key after whatever was declared there is undeclared, and goes through all of it at
every further declaration (its issue 2393). With a token of its own a query took 1.3 ms at first, 1.9 ms after 1800
queries and 3.9 ms after 6000, in the asker and in everybody who heard of it.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import zenoh

from duralab_proto.keys import Keys


@dataclass
class AskingToken:
    """A declared token.

    `asker`: Its random id, which goes with the query. `session`: On which it is declared. `token`: As Zenoh gave it.
    `answered`: Set by who asked when the service is done with the query: then another query may take the token.
    """

    asker: str
    session: zenoh.Session
    token: zenoh.LivelinessToken
    answered: bool = False


class AskingTokens:
    """The tokens of one bus; as many as it ever had queries at a time. Safe for threads."""

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._lock = threading.Lock()
        self._idle: list[AskingToken] = []

    @contextmanager
    def held(self, session: zenoh.Session) -> Iterator[AskingToken]:
        """Hold a token for a query on a session.

        One whose query was not answered is undeclared at the end, and its id never comes again: the service is to know
        that nobody waits for this query any more.
        """
        token = self._idle_on(session) or self._declared(session)
        try:
            yield token
        finally:
            if token.answered:
                with self._lock:
                    self._idle.append(token)
            else:
                # With a session that is closed it is gone already.
                with suppress(zenoh.ZError):
                    token.token.undeclare()

    def _idle_on(self, session: zenoh.Session) -> AskingToken | None:
        with self._lock:
            # Those of a session that another has taken the place of went with it.
            self._idle = [token for token in self._idle if token.session is session]
            if not self._idle:
                return None
            token = self._idle.pop()
        token.answered = False
        return token

    def _declared(self, session: zenoh.Session) -> AskingToken:
        asker = secrets.token_hex(16)
        return AskingToken(asker, session, session.liveliness().declare_token(self._keys.asking(asker)))
