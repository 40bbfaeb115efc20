"""Certificates of a secured lab: its authority, and one certificate for each member.

A folder holds `ca.crt` and `ca.key`, and a pair `<role>.<name>.crt` and `.key` for each member. Keys are readable by
their owner only. With `ca.key` new members can be made: do not copy it to machines that only need their own pair.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from duralab.errors import InputError
from duralab.security.members import MemberEntry
from duralab_bus import DEFAULT_PORT, member_of, router_configuration
from duralab_proto.keys import KeyNameError, Keys
from duralab_proto.members import ROUTER, Member, MemberError
from duralab_settings import OPEN_BINARY, read_regular

AUTHORITY: Final = "ca"
"""Name of the authority's files."""

LARGEST_BYTES: Final = 2**20
"""Largest size of a certificate or key file; a usual one has a few thousand bytes."""

_KEY_MODE: Final = 0o600
_CERTIFICATE_MODE: Final = 0o644


@dataclass(frozen=True)
class CertificateFile:
    """Certificate in a folder.

    `name`: Common name, e.g. "operator.anna"; "ca" for the authority. `path`: Path of the certificate; the key is
    beside it. `begins`, `expires`: Period of validity. `hosts`: Names and addresses of a router; otherwise empty.
    `fingerprint`: SHA-256, in hexadecimal digits. `member`: Its member; None for the authority and for a certificate
    that names no member.
    """

    name: str
    path: Path
    begins: datetime
    expires: datetime
    hosts: tuple[str, ...]
    fingerprint: str
    member: Member | None

    @property
    def key(self) -> Path:
        """Path of the private key."""
        return self.path.with_suffix(".key")

    def days_left(self) -> float:
        """Return the remaining validity in days; negative if expired."""
        return (self.expires - datetime.now(UTC)) / timedelta(days=1)


def read_certificates(folder: Path) -> list[CertificateFile]:
    """Return all certificates of a folder, the authority first."""
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; make a lab's certificates with `duralab certs init`.")
    names = sorted(path.stem for path in folder.glob("*.crt"))
    return [read_certificate(folder, name) for name in sorted(names, key=lambda name: name != AUTHORITY)]


def read_certificate(folder: Path, name: str) -> CertificateFile:
    """Return the data of a certificate in a folder."""
    path = folder / f"{name}.crt"
    certificate = load_certificate(path)
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = tuple(str(host.value) for host in names if not isinstance(host, x509.UniformResourceIdentifier))
    except x509.ExtensionNotFound:
        hosts = ()
    try:
        member = member_of(certificate)
    except MemberError:
        member = None
    return CertificateFile(
        name=name,
        path=path,
        begins=certificate.not_valid_before_utc,
        expires=certificate.not_valid_after_utc,
        hosts=hosts,
        fingerprint=certificate.fingerprint(hashes.SHA256()).hex(),
        member=member,
    )


def load_certificate(path: Path) -> x509.Certificate:
    """Return a certificate; raises InputError if it cannot be read."""
    try:
        return x509.load_pem_x509_certificate(read_regular(path, largest=LARGEST_BYTES))
    except OSError as error:
        raise InputError(
            f"The certificate {path} cannot be read: {error.strerror}; correct the folder, or "
            "make it with `duralab certs`."
        ) from error
    except ValueError as error:
        maker = "init" if path.stem == AUTHORITY else "issue"
        raise InputError(
            f"{path} is not a certificate in PEM; put back a copy of it, or remove it and its key and make both with "
            f"`duralab certs {maker}`."
        ) from error


def expect_free(folder: Path, name: str) -> None:
    """Raise InputError if there is a certificate or a key of that name."""
    for path in (folder / f"{name}.crt", folder / f"{name}.key"):
        if path.exists():
            raise InputError(f"{path} already exists and is not overwritten; `duralab certs renew {name}` does so.")


def write_pair(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> CertificateFile:
    """Write a certificate and its key; replace existing ones."""
    content = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _replace(folder / f"{name}.key", content, mode=_KEY_MODE)
        _replace(folder / f"{name}.crt", certificate.public_bytes(serialization.Encoding.PEM), mode=_CERTIFICATE_MODE)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written: {error.strerror}; give another folder, or correct its rights."
        ) from error
    return read_certificate(folder, name)


def _replace(path: Path, content: bytes, *, mode: int) -> None:
    """Write a file atomically; it is never readable by other users."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | OPEN_BINARY, mode)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            if sys.platform != "win32":
                os.fchmod(stream.fileno(), mode)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(path)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise


AUTHORITY_DAYS: Final = 3650
DEFAULT_DAYS: Final = 365
DEFAULT_HOSTS: Final = ("localhost", "127.0.0.1")
"""Default names of the router: for clients of the same machine only."""

_AUTHORITY_OF: Final = "Duralab "
# X.509 allows a common name 64 characters.
_LONGEST_LAB: Final = 64 - len(_AUTHORITY_OF)
# Clocks of a lab differ slightly: with this margin a new certificate is valid on all machines at once.
_CLOCK_SKEW: Final = timedelta(minutes=5)
_HOST = re.compile(r"(?!-)[a-z0-9-]{1,63}(?<!-)(\.(?!-)[a-z0-9-]{1,63}(?<!-))*", re.IGNORECASE)


def init_authority(folder: Path, *, lab: str = "local") -> CertificateFile:
    """Make the authority of a lab, `ca.crt` and `ca.key`, in a folder that only its owner can read."""
    _check_lab(lab)
    expect_free(folder, AUTHORITY)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"{_AUTHORITY_OF}{lab}")])
    return _write_authority(folder, _new_key(), subject, days=AUTHORITY_DAYS)


def issue(
    folder: Path, entry: MemberEntry, *, days: int = DEFAULT_DAYS, begins: datetime | None = None
) -> CertificateFile:
    """Issue a certificate and its private key to a member.

    `begins`: Begin of its validity, with time zone; now if not given.
    """
    expect_free(folder, entry.member.common_name)
    return _write_certificate(folder, entry, days=days, begins=begins)


def issue_missing(folder: Path, members: Sequence[MemberEntry], *, days: int = DEFAULT_DAYS) -> list[CertificateFile]:
    """Issue certificates to all members without one; raise InputError if a certificate contradicts the members."""
    missing = [entry for entry in members if not _agrees(folder, entry)]
    return [issue(folder, entry, days=days) for entry in missing]


def renew(folder: Path, name: str, *, members: Sequence[MemberEntry] = (), days: int | None = None) -> CertificateFile:
    """Replace the certificate and the key of a member by new ones, from the present list of members.

    "ca" renews the authority with its existing key, so that issued certificates stay valid.
    """
    if name == AUTHORITY:
        certificate, key = _authority(folder)
        return _write_authority(folder, key, certificate.subject, days=days or AUTHORITY_DAYS)
    entry = next((entry for entry in members if entry.member.common_name == name), None)
    if entry is None:
        raise InputError(f"{name} is not among the members; add it to the file of members, or name one that is listed.")
    read_certificate(folder, name)
    return _write_certificate(folder, entry, days=days or DEFAULT_DAYS)


def configure_router(
    folder: Path,
    members: Sequence[MemberEntry],
    *,
    lab: str = "local",
    certificates: str,
    port: int = DEFAULT_PORT,
) -> str:
    """Return the configuration of a router, as JSON5: it admits the members, each for its own keys of the bus.

    A certificate with a name that is not listed is refused. `certificates`: Folder on the router with its own pair and
    `ca.crt`.
    """
    _check_lab(lab)
    if without := [entry.member.common_name for entry in members if not _agrees(folder, entry)]:
        raise InputError(
            f"{folder} holds no certificate of {', '.join(without)}; issue what is missing with `duralab certs issue`."
        )
    (router,) = (entry.name for entry in members if entry.role == ROUTER)
    return router_configuration(
        [entry.member for entry in members],
        lab=lab,
        version=version("eclipse-zenoh"),
        certificates=certificates,
        router=router,
        port=port,
    )


def _agrees(folder: Path, entry: MemberEntry) -> bool:
    """Return whether a member has a certificate; raise InputError if it contradicts the members."""
    name = entry.member.common_name
    if not (folder / f"{name}.crt").exists():
        return False
    file = read_certificate(folder, name)
    if (file.member, file.hosts) != (entry.member, _hosts_of(entry)):
        raise InputError(
            f"{file.path} was issued for other rigs, another project or other hosts than the members list; make a new "
            f"one with `duralab certs renew {name}`."
        )
    return True


def _hosts_of(entry: MemberEntry) -> tuple[str, ...]:
    return (entry.hosts or DEFAULT_HOSTS) if entry.role == ROUTER else ()


def _check_lab(lab: str) -> None:
    try:
        Keys(lab)
    except KeyNameError as error:
        raise InputError(str(error), field="lab") from error
    if len(lab) > _LONGEST_LAB:
        raise InputError(
            f"The lab {lab!r} has {len(lab)} characters; at most {_LONGEST_LAB} fit into a certificate.", field="lab"
        )


def _new_key() -> ec.EllipticCurvePrivateKey:
    return ec.generate_private_key(ec.SECP256R1())


def _authority(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    certificate = load_certificate(folder / f"{AUTHORITY}.crt")
    path = folder / f"{AUTHORITY}.key"
    try:
        key = serialization.load_pem_private_key(read_regular(path, largest=LARGEST_BYTES), password=None)
    except OSError as error:
        raise InputError(
            f"The authority's key {path} cannot be read ({error.strerror}); issue certificates where it is kept."
        ) from error
    except (ValueError, TypeError) as error:
        raise InputError(
            f"{path} is not a private key without a password; put back the one that `duralab certs init` made."
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError(f"{path} is not a key on an elliptic curve, as `duralab certs init` makes it.")
    return certificate, key


def _write_authority(
    folder: Path, key: ec.EllipticCurvePrivateKey, subject: x509.Name, *, days: int
) -> CertificateFile:
    identifier = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    usage = _key_usage(authority=True)
    certificate = (
        _builder(subject, subject, key, days=days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(identifier, critical=False)
        .sign(key, hashes.SHA256())
    )
    return write_pair(folder, AUTHORITY, certificate, key)


def _write_certificate(
    folder: Path, entry: MemberEntry, *, days: int, begins: datetime | None = None
) -> CertificateFile:
    member = entry.member
    authority, authority_key = _authority(folder)
    key = _new_key()
    builder = _builder(
        x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, member.common_name)]),
        authority.subject,
        key,
        days=days,
        begins=begins,
    )
    server = member.role == ROUTER
    names = [_host(host) for host in _hosts_of(entry)] + [
        x509.UniformResourceIdentifier(uri) for uri in member.bindings
    ]
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    # With this purpose, a client's certificate cannot be used as a router's.
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH
    certificate = (
        builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(authority=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key()), critical=False)
        .sign(authority_key, hashes.SHA256())
    )
    if certificate.not_valid_after_utc > authority.not_valid_after_utc:
        raise InputError(
            f"{days} days are longer than the authority is valid (until {authority.not_valid_after_utc:%Y-%m-%d}); "
            "ask for fewer, or say `duralab certs renew ca`."
        )
    return write_pair(folder, member.common_name, certificate, key)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, *, days: int, begins: datetime | None = None
) -> x509.CertificateBuilder:
    if not 1 <= days <= 2 * AUTHORITY_DAYS:
        raise InputError(f"A certificate cannot be valid for {days} days; 1 to {2 * AUTHORITY_DAYS} are allowed.")
    begins = begins or datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins - _CLOCK_SKEW)
        .not_valid_after(begins + timedelta(days=days))
    )


def _key_usage(*, authority: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not authority,
        key_cert_sign=authority,
        crl_sign=authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        pass
    if _HOST.fullmatch(host) is None:
        raise InputError(f"The host {host!r} is neither a name such as lab.example.org nor an address.")
    return x509.DNSName(host)
