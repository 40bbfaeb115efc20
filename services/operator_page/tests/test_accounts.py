"""The file of accounts: made by a command, checked when it is read."""

import io
import subprocess
import sys
from types import SimpleNamespace

import pytest
from pydantic import ValidationError

from duralab_bus import ConfigError
from operator_page.accounts import PageRole, read_accounts
from operator_page.add_account import main
from operator_page.config import PageConfig


@pytest.fixture
def add(monkeypatch, capsys):
    """Return the command, run in this process: code and what it says."""

    def run(file, *arguments, password="a long password"):
        monkeypatch.setattr("sys.argv", ["add_account", str(file), *arguments])
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{password}\n"))
        try:
            code = main()
        except SystemExit as ended:
            code = ended.code
        return SimpleNamespace(returncode=code, stderr=capsys.readouterr().err)

    return run


def test_the_command_adds_an_account(tmp_path):
    command = [sys.executable, "-m", "operator_page.add_account", str(tmp_path / "accounts.yaml"), "Ada", "operator"]
    subprocess.run(command, input="a long password\n", capture_output=True, text=True, check=True)
    assert read_accounts(tmp_path / "accounts.yaml").role_of("Ada", "a long password") is PageRole.OPERATOR


def test_an_account_is_added_and_replaced_and_its_password_is_nowhere(tmp_path, add):
    file = tmp_path / "accounts.yaml"
    assert add(file, "Ada Lovelace", "operator").returncode == 0
    assert add(file, "Vera", "viewer", password="something else").returncode == 0
    accounts = read_accounts(file)
    assert accounts.role_of("Ada Lovelace", "a long password") is PageRole.OPERATOR
    assert accounts.role_of("Vera", "something else") is PageRole.VIEWER
    assert accounts.role_of("Vera", "a long password") is None
    assert accounts.role_of("nobody", "of nobody") is None
    assert add(file, "Vera", "operator", password="another password").returncode == 0
    assert read_accounts(file).role_of("Vera", "another password") is PageRole.OPERATOR
    assert "long password" not in file.read_text()
    assert file.stat().st_mode & 0o077 == 0


def test_an_account_may_have_a_certificate_and_keeps_its_password(tmp_path, add):
    file = tmp_path / "accounts.yaml"
    assert add(file, "Ada", "operator", "--certificate", "operator.anna").returncode == 0
    assert read_accounts(file).certificates == {"operator.anna": "Ada"}
    assert read_accounts(file).role_of("Ada", "of nobody") is None
    assert add(file, "Ada", "operator").returncode == 0
    accounts = read_accounts(file)
    assert accounts.certificates == {"operator.anna": "Ada"}
    assert accounts.role_of("Ada", "a long password") is PageRole.OPERATOR
    before = file.read_text()
    for arguments, said in (
        (("Eve", "operator", "--certificate", "operator.anna"), "Ada and Eve have the certificate operator.anna"),
        (("Eve", "operator", "--certificate", "viewer.eve"), "is an operator with the certificate viewer.eve"),
        (("Eve", "viewer", "--certificate", "rig.front"), "--certificate is 'rig.front'; give operator.NAME or"),
    ):
        done = add(file, *arguments)
        assert (done.returncode, said in done.stderr) == (2, True), done.stderr
    assert file.read_text() == before
    file.write_text("accounts: {Ada: {role: operator}}\n")
    with pytest.raises(ConfigError, match="has neither password nor certificate"):
        read_accounts(file)


@pytest.mark.parametrize(
    ("arguments", "password", "said"),
    [
        (("Ada", "operator"), "short", "The password has 5 characters; give 10 to 200."),
        (("<b>", "operator"), "a long password", "NAME is '<b>'"),
        (("Ada", "boss"), "a long password", "invalid choice: 'boss'"),
    ],
)
def test_what_is_not_allowed_is_refused_and_writes_nothing(tmp_path, add, arguments, password, said):
    file = tmp_path / "accounts.yaml"
    done = add(file, *arguments, password=password)
    assert done.returncode == 2
    assert said in done.stderr
    assert not file.exists()


def test_a_password_in_the_clear_is_refused_when_the_file_is_read(tmp_path):
    file = tmp_path / "accounts.yaml"
    file.write_text("accounts: {Ada: {role: operator, password: hunter2}}\n")
    with pytest.raises(ConfigError, match="is no hash of argon2"):
        read_accounts(file)


def test_the_page_listens_to_others_with_tls_and_accounts_only(tmp_path):
    with pytest.raises(ValidationError, match="others reach; give `tls` and `accounts`"):
        PageConfig(host="0.0.0.0", accounts=tmp_path / "a")
    with pytest.raises(ValidationError, match="give the number of an address"):
        PageConfig(host="rig.example")
    tls = {"certificate": tmp_path / "c", "key": tmp_path / "k"}
    PageConfig(host="192.0.2.1", accounts=tmp_path / "a", tls=tls)
    PageConfig(host="::1")
    with pytest.raises(ValidationError, match=r"tls\.client_ca is given; give `accounts`"):
        PageConfig(tls={**tls, "client_ca": tmp_path / "ca"})
    secured = {"mode": "client", "connect": ["tls/192.0.2.1:7447"], "tls": {**tls, "ca": tmp_path / "ca"}}
    with pytest.raises(ValidationError, match="the lab is secured"):
        PageConfig(bus=secured)
