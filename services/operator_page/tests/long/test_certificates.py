"""Signing in with a certificate of the lab, over real TLS: whose it has to be, and what it does not open."""

import ssl
from datetime import UTC, datetime, timedelta

import pytest
import yaml
from page_lab import PASSWORDS, RIG, Client, write_accounts

from duralab import RigMode
from duralab.security import MemberEntry, init_authority, issue
from duralab_bus import ConfigError
from operator_page.config import PageConfig
from operator_page.service import build

RESET = f"/api/rigs/{RIG}/reset"


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Certificates of the lab, and in `other` one of the same name of another authority."""
    folder = tmp_path_factory.mktemp("certificates")
    init_authority(folder)
    issue(folder, MemberEntry(role="router", name="page", hosts=("127.0.0.1",)))
    for name in ("ada", "guest"):
        issue(folder, MemberEntry(role="operator", name=name))
    issue(folder, MemberEntry(role="viewer", name="hall"))
    issue(folder, MemberEntry(role="recorder", name="main"))
    begins = datetime.now(UTC) - timedelta(days=2)
    issue(folder, MemberEntry(role="operator", name="late"), days=1, begins=begins)
    init_authority(folder / "other")
    issue(folder / "other", MemberEntry(role="operator", name="ada"))
    return folder


@pytest.fixture(scope="module")
def page(page_lab, certificates):
    tls = {
        "certificate": str(certificates / "router.page.crt"),
        "key": str(certificates / "router.page.key"),
        "client_ca": str(certificates / "ca.crt"),
    }
    path = write_accounts(page_lab.folder / "certified.accounts.yaml")
    document = yaml.safe_load(path.read_text())
    document["accounts"]["Ada"]["certificate"] = "operator.ada"
    document["accounts"]["Late"] = {"role": "operator", "certificate": "operator.late"}
    document["accounts"]["Hall"] = {"role": "viewer", "certificate": "viewer.hall"}
    path.write_text(yaml.safe_dump(document))
    return page_lab.page("certified", accounts=str(path), tls=tls)


@pytest.fixture
def client(page, certificates):
    """Return a client with a certificate, of the lab's folder or another one; without where none is named."""

    def connect(name="", folder=None):
        tls = ssl.create_default_context(cafile=str(certificates / "ca.crt"))
        if name:
            folder = folder or certificates
            tls.load_cert_chain(folder / f"{name}.crt", folder / f"{name}.key")
        return Client(page.address, tls)

    return connect


def test_a_certificate_of_an_account_signs_in_and_its_name_stands_in_what_is_done(page_lab, client):
    ada = client("operator.ada")
    assert ada.open()["certificate"] == "operator.ada"
    assert ada.get("/api/recordings")[0] == 401
    status, answer = ada.post("/api/sign_in_by_certificate")
    assert (status, answer["name"], answer["role"]) == (200, "Ada", "operator")
    ada.token = answer["token"]
    page_lab.lab.stop_rig(RIG, reason="a test")
    assert ada.act(RESET, {"reason": "looked at it"}) == (200, {"mode": "idle"})
    assert page_lab.lab.state(RIG).reset_name == "Ada"
    assert ada.post("/api/sign_out")[0] == 200
    assert ada.get("/api/recordings")[0] == 401


def test_a_viewer_by_certificate_sees_and_moves_nothing(page_lab, client):
    hall = client("viewer.hall")
    hall.token = hall.post("/api/sign_in_by_certificate")[1]["token"]
    assert hall.get("/api/recordings")[0] == 200
    page_lab.lab.stop_rig(RIG, reason="a test")
    status, answer = hall.act(RESET, {"reason": "x"})
    assert (status, answer["error"]) == (403, "Hall is a viewer; ask an operator to do this.")
    assert page_lab.lab.state(RIG).mode is RigMode.INTERLOCKED
    page_lab.lab.reset(RIG)


@pytest.mark.parametrize("name", ["operator.guest", "recorder.main"])
def test_a_certificate_of_no_account_is_refused_in_a_sentence(client, name):
    status, answer = client(name).post("/api/sign_in_by_certificate")
    sentence = f"The certificate {name!r} belongs to no account of this page; choose another one, or give a password."
    assert (status, answer["error"]) == (401, sentence)


def test_who_shows_no_certificate_signs_in_with_a_password(client):
    vera = client()
    assert "certificate" not in vera.open()
    status, answer = vera.post("/api/sign_in_by_certificate")
    assert (status, answer["error"]) == (
        401,
        "Your browser showed no certificate of this lab; choose one, or give a password.",
    )
    assert vera.sign_in("Vera", PASSWORDS["Vera"])[0] == 200
    # An account without a password is not one with an empty or any other one.
    for word in ("x", "None", "of nobody"):
        assert client().sign_in("Late", word)[0] == 401


@pytest.mark.parametrize(
    ("name", "folder", "why"),
    [
        (
            "operator.ada",
            "other",
            "signature failure|unable to get local issuer",
        ),
        ("operator.late", ".", "certificate has expired"),
        ("router.page", ".", "unsuitable certificate purpose"),
    ],
)
def test_a_certificate_that_cannot_be_trusted_ends_the_connection_and_the_log_says_why(
    page, certificates, client, name, folder, why
):
    with pytest.raises((ssl.SSLError, ConnectionError)):
        client(name, certificates / folder)
    refused = [line["reason"] for line in page.log if line["event"] == "a browser's certificate is refused"]
    assert any(part in refused[-1] for part in why.split("|")), refused
    assert page.process.poll() is None


def test_a_stolen_cookie_is_of_no_use_without_its_certificate(client):
    ada = client("operator.ada")
    ada.token = ada.post("/api/sign_in_by_certificate")[1]["token"]
    for thief in (client(), client("operator.guest"), client("viewer.hall")):
        thief.cookie, thief.token = ada.cookie, ada.token
        assert thief.get("/api/recordings")[0] == 401
        assert thief.post(f"/api/rigs/{RIG}/stop")[0] == 401
    assert ada.get("/api/recordings")[0] == 200


def test_another_site_cannot_have_a_browser_sign_in_with_its_certificate(client):
    ada = client("operator.ada")
    assert ada.post("/api/sign_in_by_certificate", Origin="https://evil.example")[0] == 403
    assert ada.post("/api/sign_in_by_certificate", Content_Type="text/plain")[0] == 415


def test_accounts_with_certificates_and_no_authority_are_refused_at_the_start(tmp_path):
    file = tmp_path / "accounts.yaml"
    file.write_text("accounts: {Ada: {role: operator, certificate: operator.ada}}\n")
    with pytest.raises(ConfigError, match=r"give the authority of those in `tls\.client_ca`"):
        build(PageConfig(accounts=file, folder=tmp_path / "page"))(None).__enter__()


def test_nothing_older_than_tls_1_3_is_spoken(certificates, page):
    tls = ssl.create_default_context(cafile=str(certificates / "ca.crt"))
    tls.maximum_version = ssl.TLSVersion.TLSv1_2
    with pytest.raises((ssl.SSLError, ConnectionError)):
        Client(page.address, tls)
