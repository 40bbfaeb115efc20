"""What a session shows a secured lab, checked before it is shown; and why a router lets a session not in."""

from __future__ import annotations

import os
import socket
import ssl
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from duralab_bus.faults import BusError
from duralab_bus.session.config import TlsConfig
from duralab_proto.access import Holder, HolderNameError
from duralab_settings import read_regular, require_regular

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

_BEYOND_OWNER: Final = 0o077
_BEYOND_GROUP: Final = 0o037
_PROBE_SECONDS: Final = 2.0
_LARGEST_BYTES: Final = 2**20


@dataclass(frozen=True)
class Identity:
    """Who a session is to a secured lab.

    Parameters
    ----------
    holder : Holder
        Role and name in its certificate.
    expires : datetime
        When the router closes its link.
    """

    holder: Holder
    expires: datetime


def check_identity(tls: TlsConfig) -> Identity:
    """Check certificate, key and authority of a session, and return who it is.

    Parameters
    ----------
    tls : TlsConfig
        The files to check.

    Returns
    -------
    Identity
        Role, name and expiry in the certificate.

    Raises
    ------
    BusError
        One sentence: a file is missing or cannot be read, the key is open to others or belongs to another certificate,
        the certificate has expired, is of another authority or names no role.
    """
    # Only who needs it pays for it.
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

    _expect_private(tls.key)
    authority = _certificate(tls.ca, "certificate authority")
    own = _certificate(tls.certificate, "certificate")
    try:
        key = load_pem_private_key(_read(tls.key, "private key"), password=None)
    except (ValueError, TypeError) as error:
        raise BusError(f"{tls.key} is not a private key in PEM without a password; issue one anew.") from error
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
    return Identity(_holder(own, tls.certificate), own.not_valid_after_utc)


def explain_refusal(host: str, port: int, tls: TlsConfig) -> str:
    """Return why a router that answers lets a session not in: Zenoh itself only says that it could not connect."""
    name = _holder(_certificate(tls.certificate, "certificate"), tls.certificate).common_name
    context = ssl.create_default_context(cafile=str(tls.ca))
    context.load_cert_chain(tls.certificate, tls.key)
    try:
        with (
            socket.create_connection((host, port), timeout=_PROBE_SECONDS) as plain,
            context.wrap_socket(plain, server_hostname=host) as secured,
        ):
            # What the router thinks of this certificate comes after the handshake, instead of the first bytes; where it
            # likes it, it waits for more.
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
    # A secret that an orchestrator mounts belongs to root and is lent to the service's group.
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


def _holder(certificate: Certificate, path: Path) -> Holder:
    from cryptography.x509.oid import NameOID

    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    try:
        return Holder.parse(str(names[0].value) if names else "")
    except HolderNameError as error:
        raise BusError(f"{error} It stands in {path}; have one issued with `duralab certs issue`.") from error
