"""The compose file's containers run: read-only, as nobody, healthy, at work, and gone when they are told."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from duralab.security import MemberEntry, init_authority, issue, issue_missing, read_members

from .compose_file import ROOT
from .containers_as_processes import ContainersAsProcesses, why_not

pytestmark = [
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "possible"),
    pytest.mark.timeout(300),
]
USER = 10001
HEALTHY_SECONDS = 120.0
SERVICES = ("rig", "file-rig", "identifier", "iterator", "sequencer", "recorder", "page")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    init_authority(folder)
    issue_missing(folder, read_members(ROOT / "deploy" / "router" / "members.yaml"))
    # What browsers see, of an authority of its own, and who may sign in.
    init_authority(folder / "browsers")
    shown = issue(folder / "browsers", MemberEntry(role="router", name="page", hosts=("localhost",)))
    shutil.copy(shown.path, folder / "page.crt")
    shutil.copy(shown.key, folder / "page.key")
    accounts = {"Ada": {"role": "operator", "certificate": "operator.main"}}
    (folder / "accounts.yaml").write_text(yaml.safe_dump({"accounts": accounts}))
    # As the guide says: keys are readable by their owner alone, who is the user of the containers.
    for path in folder.glob("*.*"):
        os.chown(path, USER, USER)
    return folder


@pytest.fixture(scope="module")
def lab(certificates: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ContainersAsProcesses]:
    folder = tmp_path_factory.mktemp("containers")
    with ContainersAsProcesses(folder, certificates=certificates, network=f"duralab-{os.getpid()}") as lab:
        for name in ("router", "viewer"):
            lab.start(name)
        if shutil.which("nc") is not None:
            lab.wait_until_healthy("router", timeout_seconds=HEALTHY_SECONDS)
        for name in SERVICES:
            lab.start(name)
        for name in (*SERVICES, "viewer"):
            lab.wait_until_healthy(name, timeout_seconds=HEALTHY_SECONDS)
        yield lab


def test_lab_of_containers_plays_a_drive(lab: ContainersAsProcesses, certificates: Path) -> None:
    script = ROOT / "tests" / "deploy" / "operator_script.py"
    # The name of the router is known in the containers alone.
    hosts = 'mount --bind "$0" /etc/hosts && exec "$@"'
    play = [sys.executable, str(script), str(certificates), "front_axle"]
    done = lab.run_beside(["unshare", "--mount", "sh", "-c", hosts, str(lab.hosts), *play])
    assert done.returncode == 0, done.stderr
    written = json.loads(done.stdout)
    assert written["troubles"] == []
    assert written["playbacks"] == 1.0
    assert {"rig_sim/front_axle", "rig_sim/predecessor", "rig_sim/front_axle_controller"} <= set(written["live"])
    assert {"iterator/main", "recorder/main"} <= set(written["live"])
    assert written["received"] > 0


@pytest.mark.parametrize("name", ["router", *SERVICES, "viewer"])
def test_container_is_nobody_and_may_do_nothing(lab: ContainersAsProcesses, name: str) -> None:
    status = Path(f"/proc/{lab.process_id(name)}/status").read_text()
    fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    assert set(fields["Uid"].split()) == set(fields["Gid"].split()) == {str(USER)}
    assert {int(fields[kind], 16) for kind in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb")} == {0}
    assert fields["NoNewPrivs"].strip() == "1"


_SIGN_IN = """
import http.client, json, ssl, sys
tls = ssl.create_default_context(cafile=sys.argv[1])
tls.load_cert_chain(sys.argv[2] + ".crt", sys.argv[2] + ".key")
page = http.client.HTTPSConnection("localhost", 7480, context=tls)
page.request("GET", "/api/session")
version = json.load(page.getresponse())["version"]
headers = {"Content-Type": "application/json", "X-Duralab-Page": version}
page.request("POST", "/api/sign_in_by_certificate", "{}", headers)
sys.stdout.write(json.dumps(json.load(page.getresponse())))
"""


def test_a_person_signs_in_at_the_page_of_containers(lab: ContainersAsProcesses, certificates: Path) -> None:
    authority, person = certificates / "browsers" / "ca.crt", certificates / "operator.main"
    done = lab.run_beside([sys.executable, "-c", _SIGN_IN, str(authority), str(person)])
    assert done.returncode == 0, done.stderr
    signed_in = json.loads(done.stdout)
    assert (signed_in["name"], signed_in["role"]) == ("Ada", "operator")


@pytest.mark.parametrize("name", ["rig", "file-rig", "recorder", "page"])
def test_container_writes_to_its_volumes_and_tmp_and_nowhere_else(lab: ContainersAsProcesses, name: str) -> None:
    volumes = [mount.target for mount in lab.containers[name].mounts if not mount.read_only]
    script = "for place; do touch $place/probe 2>/dev/null && rm $place/probe && echo $place; done; true"
    tried = lab.run(name, ["sh", "-c", script, "sh", "/", "/etc/duralab/certificates", str(ROOT), "/tmp", *volumes])
    assert tried.stdout.split() == ["/tmp", *volumes]


def test_health_check_of_who_is_not_there_fails(lab: ContainersAsProcesses) -> None:
    checked = lab.run("rig", ["python", "-m", "duralab_bus.health", "rig_sim", "nobody", "--timeout", "2"])
    assert checked.returncode == 1
    assert checked.stderr.startswith("Not on the bus after 2 s: rig_sim/nobody")


# The last: nothing of the lab is left afterwards.
def test_container_ends_in_order_when_it_is_told(lab: ContainersAsProcesses) -> None:
    codes = {name: lab.stop(name) for name in SERVICES}
    assert codes == dict.fromkeys(SERVICES, 0), {name: lab.log(name).read_text()[-2000:] for name in SERVICES}
    for name in SERVICES:
        entries = [json.loads(line) for line in lab.log(name).read_text().splitlines() if line.startswith("{")]
        assert [entry["event"] for entry in entries][-2:] == ["ending", "ended"]
        assert entries[-2]["why"] == "SIGTERM"
        assert entries[0]["event"] != "ready" or entries[0]["metrics"].endswith("/metrics")
