"""What a session shows a secured lab is checked before anything is sent; each finding is one sentence."""

import os
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from pydantic import ValidationError

from duralab_bus import BusConfig, BusError, TlsConfig, open_bus
from duralab_bus.session.session import check_identity


def name(common_name):
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def signed(common_name, key, *, issuer, issuer_key, begins=timedelta(hours=-1), ends=timedelta(hours=1)):
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(name(common_name))
        .issuer_name(name(issuer))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + begins)
        .not_valid_after(now + ends)
        .sign(issuer_key, hashes.SHA256())
    )


class Files:
    """A session's three files, of which one is spoiled."""

    def __init__(self, folder):
        self.tls = TlsConfig.of(folder / "operator.anna")
        self.authority_key = ec.generate_private_key(ec.SECP256R1())
        self.key = ec.generate_private_key(ec.SECP256R1())
        self.write(self.tls.ca, signed("lab", self.authority_key, issuer="lab", issuer_key=self.authority_key))
        self.issue("operator.anna")
        self.write_key(self.key)

    def issue(self, common_name, **times):
        certificate = signed(common_name, self.key, issuer="lab", issuer_key=self.authority_key, **times)
        self.write(self.tls.certificate, certificate)

    def write(self, path, certificate):
        path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))

    def write_key(self, key, encryption=None):
        self.tls.key.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                encryption or serialization.NoEncryption(),
            )
        )
        self.tls.key.chmod(0o600)

    def finding(self):
        with pytest.raises(BusError) as caught:
            check_identity(self.tls)
        return str(caught.value)


@pytest.fixture
def files(tmp_path):
    return Files(tmp_path)


def test_sound_files_say_who_it_is_and_until_when(files):
    identity = check_identity(files.tls)
    assert (identity.member.role, identity.member.name) == ("operator", "anna")
    assert timedelta(minutes=50) < identity.expires - datetime.now(UTC) < timedelta(hours=1)


@pytest.mark.parametrize("missing", ["ca", "certificate", "key"])
def test_a_missing_file_is_named(files, missing):
    path = getattr(files.tls, missing)
    path.unlink()
    assert f"{path} cannot be read: No such file or directory" in files.finding()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o777])
def test_a_key_that_others_may_read_is_refused_with_what_to_do(files, mode):
    files.tls.key.chmod(mode)
    said = files.finding()
    assert f"mode {mode:o}" in said
    assert "chmod 600" in said


def test_a_key_that_root_lends_to_the_services_group_is_taken(files, monkeypatch):
    files.tls.key.chmod(0o440)
    owner = files.tls.key.stat().st_uid
    if owner != 0:
        pytest.skip("only root can make a file of root")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert check_identity(files.tls).member.name == "anna"
    files.tls.key.chmod(0o444)
    assert "open to others" in files.finding()


def test_an_expired_certificate_is_refused(files):
    files.issue("operator.anna", begins=timedelta(days=-3), ends=timedelta(days=-1))
    said = files.finding()
    assert "expired on" in said
    assert "duralab certs renew" in said


def test_a_certificate_of_tomorrow_is_refused(files):
    files.issue("operator.anna", begins=timedelta(days=1), ends=timedelta(days=2))
    assert "not valid before" in files.finding()


def test_a_certificate_of_another_authority_is_refused(files):
    stranger = ec.generate_private_key(ec.SECP256R1())
    files.write(files.tls.certificate, signed("operator.anna", files.key, issuer="lab", issuer_key=stranger))
    assert "is not signed by" in files.finding()


def test_a_key_of_another_certificate_is_refused(files):
    files.write_key(ec.generate_private_key(ec.SECP256R1()))
    assert "is not that of the certificate" in files.finding()


def test_a_key_with_a_password_is_refused(files):
    files.write_key(files.key, serialization.BestAvailableEncryption(b"secret"))
    assert "without a password" in files.finding()


def test_something_else_than_a_certificate_is_refused(files):
    files.tls.certificate.write_text("-----BEGIN NOTHING-----\n")
    assert "is not a certificate in PEM" in files.finding()


def test_a_name_that_is_no_role_is_refused(files):
    files.issue("anna")
    assert "'<role>.<name>'" in files.finding()


def test_the_bus_checks_before_it_looks_for_anybody(files):
    files.tls.key.chmod(0o644)
    config = BusConfig(mode="client", connect=("tls/127.0.0.1:1",), connect_timeout_seconds=600.0, tls=files.tls)
    with pytest.raises(BusError, match="open to others"):
        open_bus(config, service="test")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"connect": ["tls/lab:7447"], "mode": "client"}, "is secured; name `ca`, `certificate` and `key` in `tls`"),
        ({"connect": ["tls/lab:7447"], "tls": True}, "must be a client of the router, not a peer"),
        (
            {"connect": ["tcp/lab:7447"], "mode": "client", "tls": True},
            "is not secured; connect to 'tls/<host>:<port>'",
        ),
    ],
)
def test_half_a_secured_configuration_is_refused(files, settings, said):
    settings = {**settings, **({"tls": files.tls} if "tls" in settings else {})}
    with pytest.raises(ValidationError, match="tls") as caught:
        BusConfig.model_validate(settings)
    assert said in str(caught.value)
