"""Opening of a Zenoh session from a BusConfig: its identity in a secured lab, and errors that a user understands."""

from __future__ import annotations

import json
import os
import re
import socket
import ssl
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import zenoh

from duralab_bus.faults import BusError
from duralab_bus.session.config import BusConfig, BusMode, TlsConfig
from duralab_proto.members import Member, MemberError
from duralab_settings import read_regular, require_regular

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

_BEYOND_OWNER: Final = 0o077
_BEYOND_GROUP: Final = 0o037
_HANDSHAKE_SECONDS: Final = 2.0
_LARGEST_BYTES: Final = 2**20


@dataclass(frozen=True)
class Identity:
    """Identity of a session in a secured lab: the member in its certificate, and when the router closes its link."""

    member: Member
    expires: datetime


def check_identity(tls: TlsConfig) -> Identity:
    """Check certificate, key and authority of a session, and return its identity.

    Parameters
    ----------
    tls : TlsConfig
        Files to check.

    Returns
    -------
    Identity
        Role, name and expiry in the certificate.

    Raises
    ------
    BusError
        A file is missing or cannot be read, the key is open to others or belongs to another certificate, the
        certificate has expired, is of another authority or names no role.
    """
    # Imported here: only secured sessions need the package.
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

    _expect_private(tls.key)
    authority = _certificate(tls.ca, "certificate authority")
    own = _certificate(tls.certificate, "certificate")
    try:
        key = load_pem_private_key(_read(tls.key, "private key"), password=None)
    except (ValueError, TypeError) as error:
        raise BusError(f"{tls.key} is not a private key in PEM without a password; issue a new one.") from error
    form = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    if key.public_key().public_bytes(*form) != own.public_key().public_bytes(*form):
        raise BusError(f"The private key {tls.key} is not that of the certificate {tls.certificate}; they go in pairs.")
    try:
        own.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise BusError(
            f"The certificate {tls.certificate} is not signed by {tls.ca}; take the authority that issued it."
        ) from error
    _expect_valid(own, tls.certificate)
    _expect_valid(authority, tls.ca)
    return Identity(_member(own, tls.certificate), own.not_valid_after_utc)


def explain_refusal(host: str, port: int, tls: TlsConfig) -> str:
    """Return why an answering router refuses a session: Zenoh itself only states that it could not connect."""
    name = _member(_certificate(tls.certificate, "certificate"), tls.certificate).common_name
    context = ssl.create_default_context(cafile=str(tls.ca))
    context.load_cert_chain(tls.certificate, tls.key)
    try:
        with (
            socket.create_connection((host, port), timeout=_HANDSHAKE_SECONDS) as plain,
            context.wrap_socket(plain, server_hostname=host) as secured,
        ):
            # The router judges this certificate after the handshake, and sends its error instead of the first
            # bytes; if it accepts the certificate, it waits for more.
            secured.recv(1)
    except TimeoutError:
        return f"it accepts the certificate of {name}; it may have as many sessions as it takes, or is overloaded"
    except ssl.SSLCertVerificationError as error:
        return (
            f"its certificate is refused here ({error.verify_message.rstrip('.')}); connect to a name or address that "
            f"it was issued for, with the `ca` that issued it ({tls.ca})"
        )
    except ssl.SSLError as error:
        reason = (error.reason or str(error)).lower().replace("_", " ")
        return f"it refuses the certificate of {name} ({reason}); have one issued by the authority that it trusts"
    except OSError as error:
        return f"it closed the link ({error.strerror or error}); is it the router of a secured lab?"
    return f"it closed the link of {name} without a word; is it the router of a secured lab?"


def _expect_private(key: Path) -> None:
    try:
        status = require_regular(key)
    except OSError as error:
        raise BusError(
            f"The private key {key} cannot be read: {error.strerror}; correct `tls`, or make it with `duralab certs`."
        ) from error
    if sys.platform == "win32":
        # On Windows the access list of the folder, not the mode of a file, decides who may read it.
        return
    # A secret that an orchestrator mounts belongs to root and is readable by the service's group.
    lent = status.st_uid == 0 and os.geteuid() != 0
    if status.st_mode & (_BEYOND_GROUP if lent else _BEYOND_OWNER):
        raise BusError(
            f"The private key {key} is open to others (mode {status.st_mode & 0o777:o}); say `chmod 600 {key}`."
        )


def _read(path: Path, what: str) -> bytes:
    try:
        return read_regular(path, largest=_LARGEST_BYTES)
    except OSError as error:
        raise BusError(
            f"The {what} {path} cannot be read: {error.strerror}; correct `tls`, or make it with `duralab certs`."
        ) from error


def _certificate(path: Path, what: str) -> Certificate:
    from cryptography.x509 import load_pem_x509_certificate

    content = _read(path, what)
    try:
        return load_pem_x509_certificate(content)
    except ValueError as error:
        raise BusError(f"The {what} {path} is not a certificate in PEM; `duralab certs` makes one.") from error


def _expect_valid(certificate: Certificate, path: Path) -> None:
    now = datetime.now(UTC)
    if now > certificate.not_valid_after_utc:
        raise BusError(
            f"The certificate {path} expired on {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; "
            "renew it with `duralab certs renew`."
        )
    if now < certificate.not_valid_before_utc:
        raise BusError(
            f"The certificate {path} is not valid before {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC; "
            "set this machine's clock."
        )


def member_of(certificate: Certificate) -> Member:
    """Return the member that a certificate names.

    Parameters
    ----------
    certificate : Certificate
        Certificate of the package cryptography.

    Returns
    -------
    Member
        Its common name and bindings.

    Raises
    ------
    MemberError
        If the certificate names no member.
    """
    from cryptography.x509 import ExtensionNotFound, SubjectAlternativeName, UniformResourceIdentifier
    from cryptography.x509.oid import NameOID

    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    try:
        others = certificate.extensions.get_extension_for_class(SubjectAlternativeName).value
        bindings = others.get_values_for_type(UniformResourceIdentifier)
    except ExtensionNotFound:
        bindings = []
    return Member.parse(str(names[0].value) if names else "", bindings)


def _member(certificate: Certificate, path: Path) -> Member:
    try:
        return member_of(certificate)
    except MemberError as error:
        raise BusError(f"{error} It is in {path}; have one issued with `duralab certs issue`.") from error


# The system chooses a free port, which is then closed again; another process may take it in between.
_PORT_ATTEMPTS: Final = 5
_PROBE_SECONDS: Final = 0.5
# A link without traffic for this time is closed, and the liveliness of a frozen process at its other end ends with it.
# Zenoh's own threads send a sign of life four times as often: a process is not taken for frozen because Python, or
# native code that holds the interpreter's lock, keeps it busy. Zenoh's default is 10 s.
LEASE_SECONDS: Final = 2.0
# Time that a stream waits for room on a link before it drops a message there, which must be replayed then. It waits
# once: while the link stays full, the following messages are dropped at once.
_FULL_LINK_MICROSECONDS: Final = 8_000
# Zenoh closes a link when a receiver does not read an answer for this time. Streams never wait (they are dropped and
# replayed); a handler whose client is frozen should wait no longer than needed. It is Zenoh's own default.
_BLOCKED_LINK_MICROSECONDS: Final = 5_000_000

# Sessions find each other through the configured endpoints, and by gossip from there. One of two peers connects, not
# both at once: of two links made at the same time one is closed again, and its declarations may be lost.
_GOSSIP: Final[Mapping[str, Any]] = {
    "enabled": True,
    "autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
}

LINK_SETTINGS: Final[Mapping[str, Any]] = {
    "lease": round(LEASE_SECONDS * 1e3),
    "keep_alive": 4,
    "queue": {
        # The largest values that Zenoh allows, of batches of 64 KiB, for streams and for queries and answers: with its
        # default, two, an answer of 2 MB took 9.4 ms instead of 8.1.
        "size": {"interactive_low": 16, "data": 16},
        "congestion_control": {
            "drop": {"wait_before_drop": _FULL_LINK_MICROSECONDS},
            "block": {"wait_before_close": _BLOCKED_LINK_MICROSECONDS},
        },
    },
}
"""Link settings of every session of a lab, its router included."""


def open_session(config: BusConfig) -> tuple[zenoh.Session, tuple[str, ...]]:
    """Open a session, connected to every endpoint of `config.connect`; return it and the endpoints that it listens at.

    Raises `BusError`: A port is in use, nothing answers at an endpoint of `connect`, the router refuses this session, a
    certificate or key is not usable, or Zenoh refuses the configuration.
    """
    for attempt in range(1, _PORT_ATTEMPTS + 1):
        listening = () if config.mode is BusMode.CLIENT else tuple(_with_port(endpoint) for endpoint in config.listen)
        try:
            return zenoh.open(_zenoh_config(config, listening)), listening
        except zenoh.ZError as error:
            taken = re.search(r"listener bound to (\S+):", str(error))
            chosen_here = taken is not None and taken[1] not in config.listen
            if not (chosen_here and attempt < _PORT_ATTEMPTS):
                raise BusError(explain_failure(str(error), config)) from error
    raise AssertionError("unreachable: the last attempt returns or raises")


def _zenoh_config(config: BusConfig, listening: tuple[str, ...]) -> zenoh.Config:
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": config.mode.value,
                "listen": {"endpoints": listening, "timeout_ms": 0, "exit_on_failure": True},
                "connect": {
                    "endpoints": config.connect,
                    # Zenoh's default is to continue without an error, and to retry forever.
                    "timeout_ms": round(config.connect_timeout_seconds * 1e3),
                    "exit_on_failure": True,
                    "retry": {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2},
                },
                "scouting": {"multicast": {"enabled": False}, "gossip": _GOSSIP},
                "adminspace": {"enabled": False},
                "transport": {
                    # Silent drops under a stalled receiver were reported with it.
                    "shared_memory": {"enabled": False},
                    "link": {"tx": LINK_SETTINGS, **_tls_settings(config)},
                },
            }
        )
    )


def _tls_settings(config: BusConfig) -> dict[str, Any]:
    tls = config.tls
    if tls is None:
        return {}
    return {
        # No unsecured links in addition.
        "protocols": ["tls"],
        "tls": {
            "root_ca_certificate": str(tls.ca),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        },
    }


def _host_and_port(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def _with_port(endpoint: str) -> str:
    """Replace port 0 by a free port: Zenoh does not report the port that it took."""
    host, port = _host_and_port(endpoint)
    if port != 0:
        return endpoint
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
            free = probe.getsockname()[1]
    except OSError as error:
        raise BusError(f"Cannot listen at {endpoint}: {error.strerror or error}; correct `listen`.") from error
    return f"{endpoint.removesuffix(':0')}:{free}"


def _answers(endpoint: str) -> bool:
    try:
        with socket.create_connection(_host_and_port(endpoint), timeout=_PROBE_SECONDS):
            return True
    except OSError:
        return False


def explain_failure(error: str, config: BusConfig) -> str:
    """Convert a Zenoh error of a session or router to one sentence with the value and the remedy."""
    if taken := re.search(r"listener bound to (\S+): \[?(.*?)(?: \(os error \d+\))? at /", error):
        if "in use" in taken[2]:
            return f"The endpoint {taken[1]} is in use by another process; end that one or choose another in `listen`."
        return f"Cannot listen at {taken[1]}: {taken[2].rpartition(': ')[2]}; correct `listen`."
    if "Unable to connect" in error:
        seconds = f"{config.connect_timeout_seconds:g} s"
        silent = [endpoint for endpoint in config.connect if not _answers(endpoint)]
        if silent:
            return f"Nothing listens at {', '.join(silent)} (tried for {seconds}); start it first or correct `connect`."
        if config.tls is not None:
            reason = explain_refusal(*_host_and_port(config.connect[0]), config.tls)
            return f"{config.connect[0]} answers but let this session not in within {seconds}: {reason}."
        return (
            f"{', '.join(config.connect)} answers but let this session not in within {seconds}; "
            "is it a Zenoh endpoint, and not that of a secured lab, which is joined at 'tls/…' with a certificate?"
        )
    reason = re.sub(r" at /\S+:\d+\.?", "", error)
    return f"Cannot open the bus: {reason}"
