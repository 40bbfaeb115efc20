"""Client certificates of browsers: verified by TLS, passed to the application; a refused one is logged."""

from __future__ import annotations

import asyncio
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import structlog
from starlette.requests import Request
from uvicorn.protocols.http.h11_impl import H11Protocol

from operator_page.sessions import RateLimit

_STATE: Final = "certificate"
# Any client of the port can cause failures: 20 log lines at once, then one per second.
_LOGGED: Final = RateLimit(20, 1)


@dataclass(frozen=True)
class PeerCertificate:
    """Certificate of a browser, from the configured authority: its common name, and the end of its validity (UTC s)."""

    name: str
    expires: float

    @property
    def seconds_left(self) -> float:
        """Time in s until it expires, negative afterwards."""
        return self.expires - time.time()


class CertificateProtocol(H11Protocol):
    """HTTP over TLS whose requests have the browser's certificate."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Store the certificate in the state of each request of the connection."""
        super().connection_made(transport)
        connection = transport.get_extra_info("ssl_object")
        self.app_state = {**self.app_state, _STATE: _read(connection.getpeercert() if connection is not None else None)}


class LoggedHandshake(ssl.SSLObject):
    """A TLS connection that logs why a certificate is refused: the browser gets only an alert."""

    def do_handshake(self) -> None:
        """Perform the handshake."""
        try:
            super().do_handshake()
        except ssl.SSLCertVerificationError as error:
            if _LOGGED.allows("handshake"):
                log = structlog.get_logger("operator_page")
                log.warning("a browser's certificate is refused", reason=error.verify_message)
            raise


def peer_certificate(request: Request) -> PeerCertificate | None:
    """Return the certificate of a request's connection; None if the browser sent none."""
    found = request.scope.get("state", {}).get(_STATE)
    return found if isinstance(found, PeerCertificate) else None


def _read(certificate: Mapping[str, Any] | None) -> PeerCertificate | None:
    if not certificate:
        return None
    names = [value for part in certificate["subject"] for key, value in part if key == "commonName"]
    # A certificate with several names is not accepted.
    return PeerCertificate(names[0], ssl.cert_time_to_seconds(certificate["notAfter"])) if len(names) == 1 else None
