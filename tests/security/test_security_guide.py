"""docs/security.md, command by command, in an empty folder; and with DURALAB_LONG_TESTS a campaign in that lab."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import yaml

import duralab
from duralab_bus import FaultError
from duralab_proto.members import Role
from duralab_proto.v1 import iterator_pb2

from .secured_lab import ROLES, running, secured_bus
from .secured_router import AUDIT_LOG, ROOT, SecuredRouter

PAGE = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
COMMANDS = [re.sub(r"(?m)^\$ ", "", block) for block in re.findall(r"```console\n(.*?)```", PAGE, flags=re.S)]
(MEMBERS,) = re.findall(r"```yaml file=members.yaml\n(.*?)```", PAGE, flags=re.S)
(CONFIGURATION,) = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.S)
ENVIRONMENT = {
    **os.environ,
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "OMP_NUM_THREADS": "1",
}


def shell(script: str, folder: Path, *, seconds: float = 170.0) -> str:
    done = subprocess.run(
        ["sh", "-euc", script],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """What the first commands of the page make."""
    folder = tmp_path_factory.mktemp("guide")
    (folder / "members.yaml").write_text(MEMBERS)
    shell(COMMANDS[0], folder)
    return folder


@pytest.fixture(scope="module")
def guided(folder) -> Iterator[SecuredRouter]:
    """The router of the page: its own configuration, on a port that is free."""
    with SecuredRouter(
        folder / "certificates", log=folder / "router.log", configuration=folder / "zenohd.json5"
    ) as router:
        yield router


def test_the_page_names_every_role_and_the_configuration_lets_in_who_was_issued_one(folder):
    assert all(f"| `{role}` |" in PAGE for role in Role)
    text = (folder / "zenohd.json5").read_text()
    subjects = json.loads(text[text.index("{") :])["access_control"]["subjects"]
    names = {name for subject in subjects for name in subject["cert_common_names"]}
    services = {"rig.front_axle", "identifier.main", "iterator.main", "sequencer.main", "recorder.main"}
    assert names == {*services, "operator.anna", "operator.ben", "viewer.hall", "viewer.guest"}


def test_the_page_has_the_roles_say_what_the_log_needs(folder):
    assert f"export RUST_LOG={AUDIT_LOG}\n" in COMMANDS


def test_an_operator_reaches_the_rig_as_the_page_says(folder, guided):
    at_port = f"tls/localhost:{guided.port}"
    configuration = CONFIGURATION.replace("tls/localhost:7447", at_port)
    (folder / "rig_sim.yaml").write_text(configuration)
    (start,) = [block for block in COMMANDS if "rig_sim" in block]
    with _started(start.strip(), folder):
        (asks,) = [block for block in COMMANDS if "DURALAB_IDENTITY" in block]
        # The rig compiles its model at its first start: people wait for it. The other services are not started here.
        (join,) = re.findall(r"^export .*$", asks, flags=re.M)
        (reset,) = re.findall(r"^duralab reset .*$", asks, flags=re.M)
        reset = reset.replace("tls/localhost:7447", at_port)
        said = shell(f"{join}\nuntil {reset}; do sleep 0.2; done", folder)
        assert "front_axle was not interlocked" in said


@contextmanager
def _started(command: str, folder: Path) -> Iterator[None]:
    with ExitStack() as stack:
        log = stack.enter_context((folder / "rig_sim.log").open("wb"))
        process = subprocess.Popen(["sh", "-c", f"exec {command}"], cwd=folder, env=ENVIRONMENT, stdout=log, stderr=log)
        try:
            yield
        finally:
            process.terminate()
            process.wait(20.0)


@pytest.mark.skipif("DURALAB_LONG_TESTS" not in os.environ, reason="a whole campaign: `make faults`")
@pytest.mark.timeout(900)
def test_a_campaign_in_the_secured_lab_gives_the_bytes_of_one_on_one_machine(
    tmp_path, certificates, router, short_document
):
    campaign = tmp_path / "campaign.yaml"
    campaign.write_text(yaml.safe_dump(short_document))
    with duralab.start(tmp_path / "embedded", rigs=("front_axle_compliant", "predecessor")) as lab:
        alone = lab.run(campaign)
    services = {name: {} for name in ROLES} | {
        "rig_sim": {"rigs": ["front_axle_compliant", "predecessor"]},
        "recorder": {"folder": str(tmp_path / "recordings")},
    }
    wanted = [("rig_sim", "front_axle_compliant"), ("rig_sim", "predecessor")]
    wanted += [(name, "main") for name in ROLES if name != "rig_sim"]
    with (
        running(services, endpoint=router.endpoint, certificates=certificates, folder=tmp_path, wanted=wanted),
        duralab.connect(router.endpoint, out=tmp_path / "out", identity=certificates / "operator.main") as lab,
    ):
        secured = lab.run(campaign)
        # The recorder knows its name, so that the command is refused also by an iterator that was started anew.
        sent = duralab.open_recording(secured.recording_path).specification
        with (
            secured_bus(router.endpoint, certificates, "operator.main") as bus,
            pytest.raises(FaultError) as again,
        ):
            bus.query(bus.keys.campaign_start(sent.rig), sent, iterator_pb2.CampaignStatus)
        assert (again.value.code_name, again.value.field) == ("ALREADY_EXISTS", "id")
    of_one, of_other = (
        [
            step.samples_hash
            for step in duralab.open_recording(result.recording_path).messages(iterator_pb2.IterationStep)
        ]
        for result in (alone, secured)
    )
    assert of_one
    assert of_one == of_other
