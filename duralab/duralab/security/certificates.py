"""The certificates of a secured lab: its own authority, and one certificate for each who may join.

A folder holds `ca.crt` and `ca.key`, and a pair `<role>.<name>.crt` and `.key` for each holder. Keys are readable by
their owner only. `ca.key` makes anybody a member of the lab: keep it off the machines that only need their own pair.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
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
from duralab.security.certificate_files import (
    AUTHORITY,
    LARGEST_BYTES,
    CertificateFile,
    expect_free,
    load_certificate,
    read_certificate,
    read_certificates,
    write_pair,
)
from duralab_bus import DEFAULT_PORT, router_configuration
from duralab_proto.access import HOLDER_ROLES, ROUTER, Holder, HolderNameError
from duralab_proto.keys import KeyNameError, Keys
from duralab_settings import read_regular

AUTHORITY_DAYS: Final = 3650
DEFAULT_DAYS: Final = 365
DEFAULT_HOSTS: Final = ("localhost", "127.0.0.1")
"""Names of the router where none are given: clients of the same machine only."""

_AUTHORITY_OF: Final = "Duralab "
# X.509 allows a common name 64 characters.
_LONGEST_LAB: Final = 64 - len(_AUTHORITY_OF)
# Clocks of a lab differ a little: a certificate is valid on all its machines at once.
_CLOCK_SKEW: Final = timedelta(minutes=5)
_HOST = re.compile(r"(?!-)[a-z0-9-]{1,63}(?<!-)(\.(?!-)[a-z0-9-]{1,63}(?<!-))*", re.IGNORECASE)


def init_authority(folder: Path, *, lab: str = "local", days: int = AUTHORITY_DAYS) -> CertificateFile:
    """Make the authority of a lab: `ca.crt` and `ca.key`.

    `folder`: Made where it is not there, for its owner only. `lab`: Name of the lab, kept in the authority's own name:
    lower case letters, digits, '-' and '_', at most 56. `days`: How long it is valid.
    Returns: The certificate of the authority.
    Raises `InputError`: There is one already, the folder cannot be written, or no lab can have this name.
    """
    _check_lab(lab)
    expect_free(folder, AUTHORITY)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"{_AUTHORITY_OF}{lab}")])
    return _write_authority(folder, _new_key(), subject, days=days)


def issue(
    folder: Path,
    role: str,
    name: str,
    *,
    hosts: Sequence[str] = (),
    days: int = DEFAULT_DAYS,
    begins: datetime | None = None,
) -> CertificateFile:
    """Issue a certificate and its private key.

    `folder`: With the authority's certificate and key. `role`: One of `duralab_proto.access.HOLDER_ROLES`. `name`: Who
    it is: lower case letters, digits, '-' and '_'. `hosts`: Names and addresses under which clients reach a router;
    localhost where none is given. Others have none. `days`: How long it is valid. `begins`: From when on, with its time
    zone; from now on where not given.
    Returns: The new certificate.
    Raises `InputError`: A value is not allowed, there is such a certificate already, or there is no authority.
    """
    try:
        holder = Holder(role, name)
    except HolderNameError as error:
        raise InputError(str(error), field="role" if role not in HOLDER_ROLES else "name") from error
    if hosts and role != ROUTER:
        raise InputError(f"A certificate of role {role} stands for no host; leave {', '.join(hosts)} out.")
    expect_free(folder, holder.common_name)
    return _write_certificate(folder, holder, hosts=tuple(hosts) or DEFAULT_HOSTS, days=days, begins=begins)


def renew(folder: Path, name: str, *, days: int | None = None) -> CertificateFile:
    """Take the place of a certificate and its key by new ones with the same name and hosts.

    `folder`: With the authority's certificate and key. `name`: The common name, e.g. "operator.anna"; "ca" renews the
    authority with the key that it has, so that what it issued stays valid. `days`: How long the new one is valid; as
    usual where not given.
    Returns: The new certificate.
    Raises `InputError`: There is no such certificate or no authority.
    """
    old = read_certificate(folder, name)
    if name == AUTHORITY:
        certificate, key = _authority(folder)
        return _write_authority(folder, key, certificate.subject, days=days or AUTHORITY_DAYS)
    return _write_certificate(folder, Holder.parse(name), hosts=old.hosts, days=days or DEFAULT_DAYS)


def configure_router(folder: Path, *, lab: str = "local", certificates: str, port: int = DEFAULT_PORT) -> str:
    """Return the configuration of a router that lets in those whose certificates are in a folder, as JSON5.

    `folder`: With the certificates of all holders, one of them a router's. A file that is taken out withdraws access.
    `lab`: Name of the lab. `certificates`: Where the router finds its own pair and `ca.crt`. `port`: Where it listens.
    Returns: The configuration.
    Raises `InputError`: There is not exactly one router's certificate, a file names no holder, or no lab can have this
    name.
    """
    _check_lab(lab)
    try:
        holders = [Holder.parse(file.name) for file in read_certificates(folder) if file.name != AUTHORITY]
    except HolderNameError as error:
        raise InputError(f"{error} Take that file out of {folder}.") from error
    routers = [holder.name for holder in holders if holder.role == ROUTER]
    if len(routers) != 1:
        raise InputError(f"{folder} holds {len(routers)} certificates of a router; one is needed.")
    return router_configuration(
        holders,
        lab=lab,
        version=version("eclipse-zenoh"),
        certificates=certificates,
        router=routers[0],
        port=port,
    )


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
            f"The authority's key {path} cannot be read ({error.strerror}); certificates are issued where it is kept."
        ) from error
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} is not the authority's private key.") from error
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
    folder: Path, holder: Holder, *, hosts: tuple[str, ...], days: int, begins: datetime | None = None
) -> CertificateFile:
    authority, authority_key = _authority(folder)
    key = _new_key()
    builder = _builder(
        x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, holder.common_name)]),
        authority.subject,
        key,
        days=days,
        begins=begins,
    )
    server = holder.role == ROUTER
    if server:
        builder = builder.add_extension(x509.SubjectAlternativeName([_host(host) for host in hosts]), critical=False)
    # A client's certificate is of no use to pose as the router.
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
    return write_pair(folder, holder.common_name, certificate, key)


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
