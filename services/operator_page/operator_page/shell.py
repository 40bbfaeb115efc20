"""Checks and headers of every answer: the name used for the page, and security headers for browsers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from operator_page.config import PageConfig
from operator_page.endpoints import error_answer

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src {viewer}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), payment=()",
    "cache-control": "no-store",
}


class Shell:
    """Wrapper of the application: checks the name used for the page, and adds security headers."""

    def __init__(self, app: ASGIApp, is_own_name: Callable[[str], bool], config: PageConfig) -> None:
        self._app, self._is_own_name = app, is_own_name
        viewer = "{0.scheme}://{0.netloc}".format(urlsplit(config.viewer)) if config.viewer else "'none'"
        policy = {"content-security-policy": POLICY.format(viewer=viewer)}
        secure = {"strict-transport-security": "max-age=31536000"} if config.tls is not None else {}
        self._headers = HEADERS | policy | secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers.setdefault(name, value)
            await send(message)

        host = dict(scope["headers"]).get(b"host", b"").decode("latin-1")
        app = self._app if self._is_own_name(host) else error_answer(421, "The page is not reached by this name.")
        await app(scope, receive, send_with_headers)
