"""The files of a lab's certificates: pairs of `<name>.crt` and `<name>.key` in one folder, read and written whole."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from duralab.errors import InputError
from duralab_settings import read_regular

AUTHORITY: Final = "ca"
"""Name of the authority's files."""

LARGEST_BYTES: Final = 2**20
"""Of a certificate or key file; one has a few thousand."""

_KEY_MODE: Final = 0o600
_CERTIFICATE_MODE: Final = 0o644


@dataclass(frozen=True)
class CertificateFile:
    """One certificate of a folder.

    `name`: Common name, e.g. "operator.anna"; "ca" for the authority. `path`: Of the certificate; the key is beside it.
    `begins`, `expires`: When it is valid. `hosts`: Names and addresses it stands for; of a router only. `fingerprint`:
    SHA-256, in hexadecimal digits.
    """

    name: str
    path: Path
    begins: datetime
    expires: datetime
    hosts: tuple[str, ...]
    fingerprint: str

    @property
    def key(self) -> Path:
        """Where its private key is."""
        return self.path.with_suffix(".key")

    def days_left(self, now: datetime | None = None) -> float:
        """Return how long it is still valid, in days; negative when it has expired.

        `now`: Moment, with its time zone; the present where not given.
        Returns: Days.
        """
        return (self.expires - (now or datetime.now(UTC))) / timedelta(days=1)


def read_certificates(folder: Path) -> list[CertificateFile]:
    """Return all certificates of a folder, the authority first.

    `folder`: The folder.
    Returns: The certificates.
    Raises `InputError`: The folder or a file cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; make a lab's certificates with `duralab certs init`.")
    names = sorted(path.stem for path in folder.glob("*.crt"))
    return [read_certificate(folder, name) for name in sorted(names, key=lambda name: name != AUTHORITY)]


def read_certificate(folder: Path, name: str) -> CertificateFile:
    """Return what a certificate of a folder says."""
    path = folder / f"{name}.crt"
    certificate = load_certificate(path)
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = tuple(str(host.value) for host in names)
    except x509.ExtensionNotFound:
        hosts = ()
    return CertificateFile(
        name=name,
        path=path,
        begins=certificate.not_valid_before_utc,
        expires=certificate.not_valid_after_utc,
        hosts=hosts,
        fingerprint=certificate.fingerprint(hashes.SHA256()).hex(),
    )


def load_certificate(path: Path) -> x509.Certificate:
    """Return a certificate, or raise InputError with one sentence."""
    try:
        return x509.load_pem_x509_certificate(read_regular(path, largest=LARGEST_BYTES))
    except OSError as error:
        raise InputError(f"The certificate {path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise InputError(f"{path} is not a certificate in PEM.") from error


def expect_free(folder: Path, name: str) -> None:
    """Raise InputError where there is a certificate or a key of that name."""
    for path in (folder / f"{name}.crt", folder / f"{name}.key"):
        if path.exists():
            raise InputError(f"{path} is there already and is not overwritten; `duralab certs renew {name}` does so.")


def write_pair(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> CertificateFile:
    """Write a certificate and its key, in the place of those that are there."""
    content = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _replace(folder / f"{name}.key", content, mode=_KEY_MODE)
        _replace(folder / f"{name}.crt", certificate.public_bytes(serialization.Encoding.PEM), mode=_CERTIFICATE_MODE)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror}.") from error
    return read_certificate(folder, name)


def _replace(path: Path, content: bytes, *, mode: int) -> None:
    """Write a file as a whole, never readable by others for a moment."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            os.fchmod(stream.fileno(), mode)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(path)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise
