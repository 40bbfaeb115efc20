"""The sign that an instance of a service is there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from labbus._rejoining import Declaration
from labbus._server import Served


class LiveToken:
    """Says that an instance of a service is there and answers for its health, until `close` or the process's end.

    Parameters
    ----------
    token : Declaration
        Of the liveliness token.
    answering : Served
        The query for its health.
    on_close : callable
        Told when it is closed.
    """

    def __init__(self, token: Declaration[Any], answering: Served, *, on_close: Callable[[LiveToken], None]) -> None:
        self._token = token
        self._answering = answering
        self._on_close = on_close
        self._closed = False

    def close(self) -> None:
        """Say it no more."""
        if not self._closed:
            self._closed = True
            self._token.undeclare()
            self._answering.close()
            self._on_close(self)
