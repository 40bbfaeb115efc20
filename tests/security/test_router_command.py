"""`duralab router`: the secured lab without a zenohd, from certificates that `duralab certs` made."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from duralab_bus import BusConfig, BusError, BusMode, FaultError, TlsConfig, open_bus
from duralab_proto.v1 import rig_pb2

from .access_trials import secured_config
from .secured_router import free_port

MEMBERS = """
members:
  - {role: router, name: main}
  - {role: rig, name: beam, rigs: [beam]}
  - {role: operator, name: anna}
  - {role: operator, name: ben, rigs: [other]}
"""
COMMAND = [sys.executable, "-m", "duralab"]


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], cwd=folder, capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the certificates of a lab, and those of another one under the same names."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "members.yaml").write_text(MEMBERS)
    for place in ("certificates", "strangers"):
        for command in ("init", "issue"):
            done = run(folder, "certs", command, "--folder", place)
            assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "lab"))


@contextmanager
def routing(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the command; give its process and where it says that it listens."""
    command = [*COMMAND, "router", "--port", str(free_port()), "--json"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            told = json.loads(process.stdout.readline())
            assert told["members"] == ["operator.anna", "operator.ben", "rig.beam"]
            yield process, told["endpoint"]
        finally:
            process.kill()


def joining(endpoint: str, identity: Path) -> BusConfig:
    return BusConfig(mode=BusMode.CLIENT, connect=(endpoint,), connect_timeout_seconds=2.0, tls=TlsConfig.of(identity))


def test_members_talk_by_their_roles_and_others_are_refused(folder: Path) -> None:
    certificates = folder / "certificates"
    with (
        routing(folder) as (_, endpoint),
        open_bus(joining(endpoint, certificates / "rig.beam"), service="rig_sim") as rig,
        open_bus(joining(endpoint, certificates / "operator.anna"), service="duralab") as anna,
    ):
        key = rig.keys.rig_description("beam")
        rig.serve(key, rig_pb2.DescriptionRequest, lambda _request, _call: rig_pb2.RigDescription(rig="beam"))
        rig.declare_live("rig_sim", "beam")
        anna.wait_for_live({("rig_sim", "beam")}, 10.0)
        asked = anna.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
        assert asked.rig == "beam"
        # An operator who poses as a rig is not heard: access control is that of the table.
        posing = secured_config(endpoint, certificates, "operator.anna")
        with zenoh.open(posing) as posed:
            token = posed.liveliness().declare_token(anna.keys.live("rig_sim", "posed"))
            with pytest.raises(FaultError):
                anna.wait_for_live({("rig_sim", "posed")}, 1.0)
            token.undeclare()
        # Nor is one who is bound to another rig: at once where our client is used, by the router where it is not.
        with open_bus(joining(endpoint, certificates / "operator.ben"), service="duralab") as ben:
            assert ben.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription).rig == "beam"
            with pytest.raises(FaultError, match=r"operator\.ben may not ask .*bound to other,") as refused:
                ben.query(ben.keys.rig_play("beam"), rig_pb2.PlayRequest(), rig_pb2.PlayResult)
            assert refused.value.code_name == "PERMISSION_DENIED"
        with pytest.raises(BusError, match="let this session not in"):
            open_bus(joining(endpoint, folder / "strangers" / "operator.anna"), service="duralab")
        plain = BusConfig(mode=BusMode.CLIENT, connect=(endpoint.replace("tls/", "tcp/"),), connect_timeout_seconds=1.0)
        with pytest.raises(BusError, match="let this session not in"):
            open_bus(plain, service="duralab")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_it_ends_cleanly_on_a_signal(folder: Path, number: signal.Signals, code: int) -> None:
    with routing(folder) as (process, _):
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == code
    assert re.fullmatch(r"(?s).*(Interrupted|Terminated); everything that was started is ended\.\n", errors)
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "router.main.key").unlink(), "router.main.key cannot be read: No such file"),
        (lambda folder: (folder / "router.main.crt").write_text("x"), "router.main.crt"),
        (lambda folder: (folder / "router.main.crt").unlink(), "holds no certificate of router.main"),
        (lambda folder: (folder / "router.main.key").chmod(0o644), "is open to others (mode 644)"),
        (lambda folder: (folder / "router.main.key").write_bytes((folder / "rig.beam.key").read_bytes()), "in pairs"),
        (lambda folder: (folder / "ca.crt").unlink(), "ca.crt cannot be read: No such file"),
    ],
)
def test_a_certificate_that_is_not_usable_is_one_sentence(folder: Path, spoil, said: str) -> None:
    spoil(folder / "certificates")
    done = run(folder, "router", "--port", str(free_port()))
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.startswith("Error: ")
    assert done.stderr.count("\n") == 1


def test_a_port_in_use_is_one_sentence(folder: Path) -> None:
    with routing(folder) as (_, endpoint):
        done = run(folder, "router", "--port", endpoint.rpartition(":")[2])
    assert done.returncode == 2
    assert f"{endpoint} is in use by another process" in done.stderr
