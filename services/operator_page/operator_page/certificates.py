"""Certificates that browsers show: verified by TLS, handed to the application; one that is refused is logged."""

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
# Whoever reaches the port can fail: so many lines at once, and one a second after that.
_LOGGED: Final = RateLimit(20, 1)


@dataclass(frozen=True)
class PeerCertificate:
    """Certificate of a browser, of the configured authority: its common name, and until when it is valid (UTC s)."""

    name: str
    expires: float

    @property
    def seconds_left(self) -> float:
        """Time until it expires, negative afterwards."""
        return self.expires - time.time()


class CertificateProtocol(H11Protocol):
    """HTTP over TLS whose requests know the certificate that the browser showed."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Keep the certificate in the state that each request of the connection is given."""
        super().connection_made(transport)
        connection = transport.get_extra_info("ssl_object")
        self.app_state = {**self.app_state, _STATE: _read(connection.getpeercert() if connection is not None else None)}


class LoggedHandshake(ssl.SSLObject):
    """A TLS connection that logs why a certificate is refused: the browser hears of an alert only."""

    def do_handshake(self) -> None:
        """Shake hands."""
        try:
            super().do_handshake()
        except ssl.SSLCertVerificationError as error:
            if _LOGGED.allows("handshake"):
                log = structlog.get_logger("operator_page")
                log.warning("a browser's certificate is refused", reason=error.verify_message)
            raise


def peer_certificate(request: Request) -> PeerCertificate | None:
    """Return the certificate of the connection of a request; None where the browser showed none."""
    found = request.scope.get("state", {}).get(_STATE)
    return found if isinstance(found, PeerCertificate) else None


def _read(certificate: Mapping[str, Any] | None) -> PeerCertificate | None:
    if not certificate:
        return None
    names = [value for part in certificate["subject"] for key, value in part if key == "commonName"]
    # One that has several names is nobody's.
    return PeerCertificate(names[0], ssl.cert_time_to_seconds(certificate["notAfter"])) if len(names) == 1 else None
