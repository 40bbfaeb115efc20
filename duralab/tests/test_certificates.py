"""A lab's certificates: private keys private, nothing overwritten unasked, renewed under the same name."""

import json
import os
import stat
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from duralab.cli.application import app
from duralab.errors import InputError
from duralab.security import configure_router, init_authority, issue, read_certificates, renew
from duralab.security.certificates import read_certificate
from duralab_bus import BusError, TlsConfig, check_identity


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "certificates"
    init_authority(made)
    return made


def loaded(file):
    return x509.load_pem_x509_certificate(file.path.read_bytes())


def refused(act):
    with pytest.raises(InputError) as caught:
        act()
    return caught.value.message


def test_what_is_issued_is_what_a_session_accepts(folder):
    for role in ("rig", "identifier", "iterator", "recorder", "operator", "viewer", "admin"):
        file = issue(folder, role, "main")
        identity = check_identity(TlsConfig.of(folder / file.name))
        assert (identity.holder.role, identity.holder.name) == (role, "main")
        assert file.days_left() == pytest.approx(365.0, abs=0.01)


def test_private_keys_are_private_whatever_the_umask_is(tmp_path):
    before = os.umask(0)
    try:
        init_authority(tmp_path / "open")
        issue(tmp_path / "open", "operator", "anna")
        renew(tmp_path / "open", "operator.anna")
    finally:
        os.umask(before)
    keys = sorted((tmp_path / "open").glob("*.key"))
    assert [stat.S_IMODE(key.stat().st_mode) for key in keys] == [0o600, 0o600]
    assert stat.S_IMODE((tmp_path / "open").stat().st_mode) == 0o700
    # Nothing is left lying beside them.
    assert len(list((tmp_path / "open").iterdir())) == 4


def test_nothing_is_overwritten_unasked(folder):
    issue(folder, "operator", "anna")
    content = {path: path.read_bytes() for path in folder.iterdir()}
    assert "is not overwritten" in refused(lambda: init_authority(folder))
    assert "duralab certs renew operator.anna" in refused(lambda: issue(folder, "operator", "anna"))
    (folder / "operator.ben.key").write_text("a key of somebody")
    assert "operator.ben.key is there already" in refused(lambda: issue(folder, "operator", "ben"))
    assert {path: path.read_bytes() for path in content} == content


def test_renewed_is_another_key_under_the_same_name_and_hosts(folder):
    old = issue(folder, "router", "main", hosts=["lab.example.org", "10.0.0.5"], days=3)
    old_key = old.key.read_bytes()
    new = renew(folder, "router.main", days=30)
    assert (new.name, new.hosts) == ("router.main", ("lab.example.org", "10.0.0.5"))
    assert new.fingerprint != old.fingerprint
    assert new.key.read_bytes() != old_key
    assert new.days_left() == pytest.approx(30.0, abs=0.01)


def test_a_renewed_authority_still_stands_for_what_it_issued(folder):
    issue(folder, "operator", "anna")
    old = read_certificate(folder, "ca")
    assert renew(folder, "ca", days=4000).expires > old.expires
    assert check_identity(TlsConfig.of(folder / "operator.anna")).holder.name == "anna"


def test_a_client_cannot_pose_as_the_router_nor_issue_certificates(folder):
    client, router = loaded(issue(folder, "operator", "anna")), loaded(issue(folder, "router", "main"))
    purposes = [c.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value for c in (client, router)]
    assert [list(purpose) for purpose in purposes] == [
        [ExtendedKeyUsageOID.CLIENT_AUTH],
        [ExtendedKeyUsageOID.SERVER_AUTH],
    ]
    for certificate in (client, router):
        assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        assert not certificate.extensions.get_extension_for_class(x509.KeyUsage).value.key_cert_sign
    with pytest.raises(x509.ExtensionNotFound):
        client.extensions.get_extension_for_class(x509.SubjectAlternativeName)


def test_another_labs_authority_stands_for_nobody_here(folder, tmp_path):
    other = tmp_path / "other"
    init_authority(other)
    issue(other, "operator", "anna")
    (other / "ca.crt").write_bytes((folder / "ca.crt").read_bytes())
    with pytest.raises(BusError, match="is not signed by"):
        check_identity(TlsConfig.of(other / "operator.anna"))


@pytest.mark.parametrize(
    ("role", "name", "more", "said"),
    [
        ("boss", "anna", {}, "is none of rig, identifier"),
        ("operator", "Anna", {}, "lower case letters"),
        ("operator", "../anna", {}, "lower case letters"),
        ("operator", "anna", {"hosts": ["lab"]}, "stands for no host"),
        ("router", "main", {"hosts": ["not a host"]}, "neither a name"),
        ("operator", "anna", {"days": 0}, "cannot be valid for 0 days"),
        ("operator", "anna", {"days": 3651}, "longer than the authority is valid"),
    ],
)
def test_a_wrong_value_is_refused_and_leaves_nothing(folder, role, name, more, said):
    assert said in refused(lambda: issue(folder, role, name, **more))
    assert sorted(path.name for path in folder.iterdir()) == ["ca.crt", "ca.key"]


@pytest.mark.parametrize(
    ("lab", "said"),
    [
        ("My Lab", "The lab 'My Lab' is not a name of lower case letters"),
        ("", "is not a name"),
        ("a" * 57, "at most 56"),
    ],
)
def test_a_lab_that_no_key_or_certificate_can_name_is_refused(folder, tmp_path, lab, said):
    for act in (
        lambda: init_authority(tmp_path / "other", lab=lab),
        lambda: configure_router(folder, lab=lab, certificates="/etc/duralab"),
    ):
        with pytest.raises(InputError) as caught:
            act()
        assert said in caught.value.message
        assert caught.value.field == "lab"
    assert not (tmp_path / "other").exists()
    assert init_authority(tmp_path / "other", lab="a" * 56).path.exists()


def test_without_an_authority_nothing_is_issued(tmp_path):
    assert "cannot be read" in refused(lambda: issue(tmp_path, "operator", "anna"))
    assert "duralab certs init" in refused(lambda: read_certificates(tmp_path / "none"))


def test_the_router_lets_in_who_has_a_certificate_in_the_folder(folder):
    assert "holds 0 certificates of a router" in refused(lambda: configure_router(folder, certificates="/etc/lab"))
    issue(folder, "router", "west")
    issue(folder, "operator", "anna")
    issue(folder, "operator", "ben")
    text = configure_router(folder, lab="west", certificates="/etc/lab", port=7450)
    content = json.loads(text[text.index("{") :])
    (subject,) = content["access_control"]["subjects"]
    assert subject["cert_common_names"] == ["operator.anna", "operator.ben"]
    assert content["transport"]["link"]["tls"]["listen_private_key"] == "/etc/lab/router.west.key"
    assert content["listen"]["endpoints"]["router"] == ["tls/0.0.0.0:7450"]
    (folder / "operator.ben.crt").unlink()
    assert "operator.ben" not in configure_router(folder, certificates="/etc/lab")
    (folder / "stranger.crt").write_bytes((folder / "ca.crt").read_bytes())
    assert "stranger" in refused(lambda: configure_router(folder, certificates="/etc/lab"))


def invoke(*arguments):
    result = CliRunner().invoke(app, ["certs", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_shows_what_has_expired_and_says_so_in_its_exit_code(folder):
    issue(folder, "operator", "anna")
    code, out, _ = invoke("show", "--folder", folder, "--json")
    assert code == 0
    assert [entry["name"] for entry in json.loads(out)] == ["ca", "operator.anna"]
    issue(folder, "operator", "late", days=1, begins=datetime.now(UTC) - timedelta(days=3))
    code, out, _ = invoke("show", "--folder", folder)
    assert code == 1
    assert "expired" in next(line for line in out.splitlines() if line.startswith("operator.late"))


def test_the_command_overwrites_a_routers_configuration_only_when_told(folder, tmp_path):
    issue(folder, "router", "main")
    out = tmp_path / "zenohd.json5"
    assert invoke("router", "--folder", folder, "--out", out)[0] == 0
    assert invoke("router", "--folder", folder, "--out", out)[0] == 2
    assert invoke("router", "--folder", folder, "--out", out, "--replace")[0] == 0
    assert f'"{folder}/router.main.key"' in out.read_text()


def test_a_wrong_role_ends_the_command_with_one_sentence(folder):
    code, _, err = invoke("issue", "boss", "anna", "--folder", folder)
    assert code == 2
    assert err.startswith("Error: The role 'boss' is none of")
