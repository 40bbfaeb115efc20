"""A lab's certificates: private keys private, nothing overwritten unasked, renewed under the same name."""

import json
import os
import stat
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from duralab.cli.application import app
from duralab.errors import InputError
from duralab.lab.client import recordings_key
from duralab.security import (
    MemberEntry,
    configure_router,
    init_authority,
    issue,
    issue_missing,
    read_certificates,
    renew,
)
from duralab.security.certificates import read_certificate
from duralab_bus import BusError, TlsConfig, check_identity
from duralab_proto.keys import Keys

ROUTER = MemberEntry(role="router", name="main")
ANNA = MemberEntry(role="operator", name="anna")
BEN = MemberEntry(role="operator", name="ben")
LATE = MemberEntry(role="operator", name="late")


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
        bound = {"rig": {"rigs": ("front_axle", "beam")}, "viewer": {"project": "wheel"}}.get(role, {})
        entry = MemberEntry(role=role, name="main", **bound)
        file = issue(folder, entry)
        assert file.member == entry.member
        assert check_identity(TlsConfig.of(folder / file.name)).member == entry.member
        assert file.days_left() == pytest.approx(365.0, abs=0.01)


def test_private_keys_are_private_whatever_the_umask_is(tmp_path):
    before = os.umask(0)
    try:
        init_authority(tmp_path / "open")
        issue(tmp_path / "open", ANNA)
        renew(tmp_path / "open", "operator.anna", members=[ANNA])
    finally:
        os.umask(before)
    keys = sorted((tmp_path / "open").glob("*.key"))
    assert [stat.S_IMODE(key.stat().st_mode) for key in keys] == [0o600, 0o600]
    assert stat.S_IMODE((tmp_path / "open").stat().st_mode) == 0o700
    # Nothing is left lying beside them.
    assert len(list((tmp_path / "open").iterdir())) == 4


def test_nothing_is_overwritten_unasked(folder):
    issue(folder, ANNA)
    content = {path: path.read_bytes() for path in folder.iterdir()}
    assert "is not overwritten" in refused(lambda: init_authority(folder))
    assert "duralab certs renew operator.anna" in refused(lambda: issue(folder, ANNA))
    (folder / "operator.ben.key").write_text("a key of somebody")
    assert "operator.ben.key already exists" in refused(lambda: issue(folder, BEN))
    assert {path: path.read_bytes() for path in content} == content


def test_renewed_is_another_key_under_the_same_name_and_hosts(folder):
    entry = MemberEntry(role="router", name="main", hosts=("lab.example.org", "10.0.0.5"))
    old = issue(folder, entry, days=3)
    old_key = old.key.read_bytes()
    new = renew(folder, "router.main", members=[entry], days=30)
    assert (new.name, new.hosts) == ("router.main", ("lab.example.org", "10.0.0.5"))
    assert new.fingerprint != old.fingerprint
    assert new.key.read_bytes() != old_key
    assert new.days_left() == pytest.approx(30.0, abs=0.01)


def test_a_renewed_authority_still_stands_for_what_it_issued(folder):
    issue(folder, ANNA)
    old = read_certificate(folder, "ca")
    assert renew(folder, "ca", days=4000).expires > old.expires
    assert check_identity(TlsConfig.of(folder / "operator.anna")).member.name == "anna"


def test_a_client_cannot_pose_as_the_router_nor_issue_certificates(folder):
    client, router = loaded(issue(folder, ANNA)), loaded(issue(folder, ROUTER))
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
    issue(other, ANNA)
    (other / "ca.crt").write_bytes((folder / "ca.crt").read_bytes())
    with pytest.raises(BusError, match="is not signed by"):
        check_identity(TlsConfig.of(other / "operator.anna"))


@pytest.mark.parametrize(
    ("entry", "days", "said"),
    [
        (MemberEntry(role="router", name="main", hosts=("not a host",)), 365, "neither a name"),
        (ANNA, 0, "cannot be valid for 0 days"),
        (ANNA, 3651, "longer than the authority is valid"),
    ],
)
def test_a_wrong_value_is_refused_and_leaves_nothing(folder, entry, days, said):
    assert said in refused(lambda: issue(folder, entry, days=days))
    assert sorted(path.name for path in folder.iterdir()) == ["ca.crt", "ca.key"]


def test_every_member_without_a_certificate_gets_one_and_the_others_keep_theirs(folder):
    first = issue(folder, ANNA)
    assert [file.name for file in issue_missing(folder, [ROUTER, ANNA, BEN])] == ["router.main", "operator.ben"]
    assert read_certificate(folder, "operator.anna").fingerprint == first.fingerprint
    assert issue_missing(folder, [ROUTER, ANNA, BEN]) == []


@pytest.mark.parametrize("change", [{"rigs": ("front_axle",)}, {"role": "router", "hosts": ("lab.example.org",)}])
def test_a_certificate_that_says_other_than_the_members_is_to_be_renewed(folder, change):
    before = MemberEntry(role=change.get("role", "operator"), name="anna")
    issue(folder, before)
    after = MemberEntry(**{"role": "operator", "name": "anna", **change})
    others = [] if after.role == "router" else [ROUTER]
    for entry in others:
        issue(folder, entry)
    name = after.member.common_name
    for act in (
        lambda: issue_missing(folder, [*others, after]),
        lambda: configure_router(folder, [*others, after], certificates="/etc/lab"),
    ):
        assert f"duralab certs renew {name}" in refused(act)
    assert renew(folder, name, members=[after]).member == after.member
    assert configure_router(folder, [*others, after], certificates="/etc/lab")


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
        lambda: configure_router(folder, [ROUTER], lab=lab, certificates="/etc/duralab"),
    ):
        with pytest.raises(InputError) as caught:
            act()
        assert said in caught.value.message
        assert caught.value.field == "lab"
    assert not (tmp_path / "other").exists()
    assert init_authority(tmp_path / "other", lab="a" * 56).path.exists()


def test_without_an_authority_nothing_is_issued(tmp_path):
    assert "cannot be read" in refused(lambda: issue(tmp_path, ANNA))
    assert "duralab certs init" in refused(lambda: read_certificates(tmp_path / "none"))


def test_the_router_lets_in_the_members_and_nobody_else(folder):
    west = MemberEntry(role="router", name="west")
    said = refused(lambda: configure_router(folder, [west, ANNA], certificates="/etc/lab"))
    assert "no certificate of router.west, operator.anna" in said
    issue_missing(folder, [west, ANNA, BEN])
    text = configure_router(folder, [west, ANNA, BEN], lab="west", certificates="/etc/lab", port=7450)
    content = json.loads(text[text.index("{") :])
    subjects = content["access_control"]["subjects"]
    assert [subject["cert_common_names"] for subject in subjects] == [["operator.anna"], ["operator.ben"]]
    assert content["transport"]["link"]["tls"]["listen_private_key"] == "/etc/lab/router.west.key"
    assert content["listen"]["endpoints"]["router"] == ["tls/0.0.0.0:7450"]
    # Who is taken out of the list is let in no more, also with a certificate that is still there.
    assert "operator.ben" not in configure_router(folder, [west, ANNA], certificates="/etc/lab")


def invoke(*arguments):
    result = CliRunner().invoke(app, ["certs", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_shows_what_has_expired_and_says_so_in_its_exit_code(folder):
    issue(folder, ANNA)
    code, out, _ = invoke("show", "--folder", folder, "--json")
    assert code == 0
    assert [entry["name"] for entry in json.loads(out)] == ["ca", "operator.anna"]
    issue(folder, LATE, days=1, begins=datetime.now(UTC) - timedelta(days=3))
    code, out, _ = invoke("show", "--folder", folder)
    assert code == 1
    assert "expired" in next(line for line in out.splitlines() if line.startswith("operator.late"))


def test_the_command_overwrites_a_routers_configuration_only_when_told(folder, tmp_path):
    members = tmp_path / "members.yaml"
    members.write_text("members: [{role: router, name: main}]")
    assert invoke("issue", "--members", members, "--folder", folder)[0] == 0
    out = tmp_path / "zenohd.json5"
    command = ("router", "--members", members, "--folder", folder, "--out", out)
    assert [invoke(*command)[0], invoke(*command)[0], invoke(*command, "--replace")[0]] == [0, 2, 0]
    assert f'"{folder}/router.main.key"' in out.read_text()


@pytest.mark.parametrize(
    ("member", "key"),
    [
        (None, "recorder/recording/list"),
        (ANNA.member, "recorder/recording/list"),
        (MemberEntry(role="viewer", name="guest", project="wheel").member, "recorder/project/wheel"),
    ],
)
def test_recordings_are_listed_as_far_as_a_member_may_read_them(member, key):
    assert recordings_key(SimpleNamespace(member=member, keys=Keys())) == f"duralab/v1/local/{key}"


def test_a_file_of_members_that_is_wrong_ends_the_command_with_one_sentence(folder, tmp_path):
    members = tmp_path / "members.yaml"
    code, _, err = invoke("issue", "--members", members, "--folder", folder)
    assert (code, err.count("\n")) == (2, 1)
    assert "No such file" in err
    members.write_text("members: [{role: boss, name: anna}]")
    code, _, err = invoke("issue", "--members", members, "--folder", folder)
    assert (code, err.count("\n")) == (2, 1)
    assert "The role 'boss' is not one of rig, identifier" in err
    members.write_text("members: [{role: router, name: main}]")
    code, _, err = invoke("renew", "operator.anna", "--members", members, "--folder", folder)
    assert code == 2
    assert "operator.anna is not among the members" in err
