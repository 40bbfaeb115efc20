"""Compose, Kubernetes and systemd: they fit their schemas, and say what a secured lab needs said."""

import shutil
import subprocess
import sys
import time

import kubernetes_validate
import pytest
import yaml
from compose_spec import PyCompose

import duralab_bus

from .compose_file import COMPOSE, ROOT, compose_document, containers

KUBERNETES = ROOT / "deploy/kubernetes"
SYSTEMD = ROOT / "deploy/systemd"
# Of a version that is served by every provider; strict: a field that the schema does not know is an error.
KUBERNETES_VERSION = "1.34"
SERVICES = ("rig", "file-rig", "identifier", "iterator", "sequencer", "recorder", "page")
MEMBERS = {"file-rig": "rig.controller", "page": "operator.page"}
# What a service has besides its certificate of the lab.
OWN_FILES = {"page": {"page.crt", "page.key", "accounts.yaml"}}
VARIABLES = {"DURALAB_CERTIFICATES": "/certificates"}


def kubernetes_objects():
    for path in sorted(KUBERNETES.glob("*.yaml")):
        for document in yaml.safe_load_all(path.read_text()):
            yield pytest.param(document, id=f"{path.stem}-{document['kind']}-{document['metadata']['name']}")


def pods():
    for path in sorted(KUBERNETES.glob("*.yaml")):
        for document in yaml.safe_load_all(path.read_text()):
            if document["kind"] in ("Deployment", "Job"):
                yield pytest.param(document["spec"]["template"], id=document["metadata"]["name"])


def test_compose_file_fits_the_compose_specification():
    # What it does not know, or is named and nowhere defined, it refuses.
    specification = PyCompose.from_yaml(yaml.safe_dump(compose_document(VARIABLES)))
    assert set(specification.service_names()) == {"router", *SERVICES, "viewer"}


def test_compose_file_needs_certificates():
    with pytest.raises(KeyError, match="DURALAB_CERTIFICATES"):
        compose_document({})


def test_docker_itself_reads_the_compose_file(tmp_path):
    plugin = (
        subprocess.run(["docker", "compose", "version"], capture_output=True, check=False)
        if shutil.which("docker")
        else None
    )
    if plugin is None or plugin.returncode != 0:
        pytest.skip("there is no docker with its compose plugin")
    checked = subprocess.run(
        ["docker", "compose", "--file", COMPOSE, "config", "--quiet"],
        env={"PATH": "/usr/bin:/bin:/usr/local/bin", "DURALAB_CERTIFICATES": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize("name", ["router", *SERVICES, "viewer"])
def test_container_may_do_nothing_but_its_work(name):
    service = compose_document(VARIABLES)["services"][name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["restart"] == "unless-stopped"
    assert {"cpus", "memory", "pids"} <= set(service["deploy"]["resources"]["limits"])
    assert "healthcheck" in service
    assert not {"privileged", "cap_add", "devices", "pid", "ipc", "network_mode"} & set(service)
    user = containers(VARIABLES)[name]
    assert user.user > 0
    assert user.group > 0


def test_nothing_but_the_router_is_open_to_others():
    services = compose_document(VARIABLES)["services"]
    ports = {name: service["ports"] for name, service in services.items() if "ports" in service}
    assert set(ports) == {"router", "page", "viewer"}
    assert ports["router"] == ["0.0.0.0:7447:7447"]
    assert all(port.startswith("127.0.0.1:") for port in (*ports["page"], *ports["viewer"]))


def test_only_its_own_certificate_is_given_to_each():
    for name, container in containers(VARIABLES).items():
        files = {mount.target.rpartition("/")[2] for mount in container.mounts if mount.read_only}
        member = MEMBERS.get(name, f"{name}.main")
        expected = {"ca.crt", f"{member}.crt", f"{member}.key"} if name != "viewer" else set()
        assert files - {"zenohd.json5", "map.yaml"} == expected | OWN_FILES.get(name, set())


@pytest.mark.parametrize("document", list(kubernetes_objects()))
def test_object_fits_the_schema_of_kubernetes(document):
    kubernetes_validate.validate(document, KUBERNETES_VERSION, strict=True)


@pytest.mark.parametrize("template", list(pods()))
def test_pod_passes_the_restricted_standard(template):
    pod = template["spec"]
    context = pod["securityContext"]
    assert context["runAsNonRoot"] is True
    assert context["runAsUser"] > 0
    assert context["seccompProfile"] == {"type": "RuntimeDefault"}
    assert pod["automountServiceAccountToken"] is False
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    assert [volume for volume in pod["volumes"] if "hostPath" in volume] == []
    for container in pod["containers"]:
        assert container["securityContext"] == {
            "readOnlyRootFilesystem": True,
            "allowPrivilegeEscalation": False,
            "capabilities": {"drop": ["ALL"]},
        }
        assert {"cpu", "memory"} <= set(container["resources"]["limits"])
        assert "latest" not in container["image"]


@pytest.mark.parametrize("name", ["router", *SERVICES, "viewer"])
def test_probes_tell_a_sick_process_from_a_bus_that_is_away(name):
    (deployment,) = [
        document
        for document in yaml.safe_load_all((KUBERNETES / f"{name}.yaml").read_text())
        if document["kind"] == "Deployment"
    ]
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    assert {"startupProbe", "livenessProbe", "readinessProbe"} <= set(container)
    # Else a router that is away would have every service started again.
    assert "exec" not in container["livenessProbe"]
    assert deployment["spec"]["strategy"] == {"type": "Recreate"}


def test_kubernetes_and_compose_start_the_same(tmp_path):
    composed = containers(VARIABLES)
    for name in (*SERVICES, "viewer"):
        deployment = next(yaml.safe_load_all((KUBERNETES / f"{name}.yaml").read_text()))
        (container,) = deployment["spec"]["template"]["spec"]["containers"]
        assert [*container["command"], *container.get("args", [])] == composed[name].command
        if name != "viewer":
            assert container["readinessProbe"]["exec"]["command"] == composed[name].health
        own = {entry["name"]: str(entry["value"]) for entry in container.get("env", [])}
        assert own == {key: value for key, value in composed[name].environment.items() if key in own}


# Settings that name a folder whose content a restart must not lose.
KEPT_FOLDERS = {
    "rig": "DURALAB__SPOOL_FOLDER",
    "file-rig": "DURALAB__SPOOL_FOLDER",
    "sequencer": "DURALAB__HELD_FOLDER",
    "recorder": "DURALAB__FOLDER",
    "page": "DURALAB__FOLDER",
}


@pytest.mark.parametrize(("name", "setting"), KEPT_FOLDERS.items())
def test_what_a_restart_must_not_lose_is_on_a_disk_of_its_own(name, setting):
    composed = containers(VARIABLES)[name]
    kept = {mount.target for mount in composed.mounts if mount.source in compose_document(VARIABLES)["volumes"]}
    assert composed.environment[setting] in kept

    deployment = next(yaml.safe_load_all((KUBERNETES / f"{name}.yaml").read_text()))
    pod = deployment["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    claims = {
        volume["name"]: volume["persistentVolumeClaim"]["claimName"]
        for volume in pod["volumes"]
        if "persistentVolumeClaim" in volume
    }
    (folder,) = [entry["value"] for entry in container["env"] if entry["name"] == setting]
    (mounted,) = [mount["name"] for mount in container["volumeMounts"] if mount["mountPath"] == folder]
    storage = yaml.safe_load_all((KUBERNETES / "storage.yaml").read_text())
    assert claims[mounted] in {claim["metadata"]["name"] for claim in storage}

    unit = (SYSTEMD / f"duralab-{name}.service").read_text().splitlines()
    (state,) = [line.partition("=")[2] for line in unit if line.startswith("StateDirectory=")]
    assert f"Environment={setting}=%S/{state}" in unit


def test_kustomization_renders_and_names_every_manifest():
    resources = yaml.safe_load((ROOT / "deploy/kustomization.yaml").read_text())["resources"]
    there = {f"kubernetes/{path.name}" for path in KUBERNETES.glob("*.yaml")}
    assert there - set(resources) == {"kubernetes/sweep-job.yaml"}
    if shutil.which("kubectl") is None:
        pytest.skip("there is no kubectl to render it")
    rendered = subprocess.run(["kubectl", "kustomize", ROOT / "deploy"], capture_output=True, text=True, check=False)
    assert rendered.returncode == 0, rendered.stderr
    documents = list(yaml.safe_load_all(rendered.stdout))
    assert {document["metadata"].get("namespace", "duralab") for document in documents} == {"duralab"}
    for document in documents:
        kubernetes_validate.validate(document, KUBERNETES_VERSION, strict=True)


@pytest.fixture
def units(tmp_path):
    """The units with programs that this machine has in the place of those of a lab."""
    shutil.copytree(SYSTEMD, tmp_path, dirs_exist_ok=True)
    for unit in tmp_path.glob("*.service"):
        lines = unit.read_text().splitlines()
        replaced = ["ExecStart=/bin/true" if line.startswith("ExecStart=") else line for line in lines]
        unit.write_text("\n".join(replaced) + "\n")
    if shutil.which("systemd-analyze") is None:
        pytest.skip("there is no systemd-analyze")
    return tmp_path


def analyze(folder, *arguments):
    return subprocess.run(
        ["systemd-analyze", *arguments],
        cwd=folder,
        env={"SYSTEMD_UNIT_PATH": f"{folder}:", "PATH": "/usr/bin:/bin", "SYSTEMD_COLORS": "0"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_systemd_finds_nothing_wrong_with_the_units(units):
    names = sorted(f"./{path.name}" for path in [*units.glob("*.service"), *units.glob("*.target")])
    assert len(names) == 9
    checked = analyze(units, "verify", "--man=no", *names)
    assert checked.stderr == ""
    assert checked.returncode == 0


@pytest.mark.parametrize("name", ["router", *SERVICES])
def test_systemd_counts_a_unit_among_the_least_exposed(units, name):
    # In tenths: below 2 of 10 is what systemd calls safe.
    checked = analyze(units, "security", "--offline=true", "--threshold=20", f"./duralab-{name}.service")
    assert checked.returncode == 0, checked.stdout[-300:]


def test_units_give_each_service_its_own_certificate_alone():
    for name in SERVICES:
        text = (SYSTEMD / f"duralab-{name}.service").read_text()
        handed = [line.rpartition(":")[2] for line in text.splitlines() if line.startswith("LoadCredential=")]
        folder = "/etc/duralab/certificates"
        member = MEMBERS.get(name, f"{name}.main")
        assert handed[:2] == [f"{folder}/{member}.crt", f"{folder}/{member}.key"]
        assert {path.removeprefix("/etc/duralab/page/") for path in handed[2:]} == OWN_FILES.get(name, set())
        assert f"-m {containers(VARIABLES)[name].command[-1]}\n" in text


_FORBID_NEW_CODE = """
import ctypes, os, sys
if ctypes.CDLL(None, use_errno=True).prctl(65, 1, 0, 0, 0) != 0:  # PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN
    sys.exit(77)
os.execv(sys.executable, [sys.executable, "-m", *sys.argv[1:]])
"""


@pytest.mark.parametrize("name", ["identifier", "iterator", "sequencer", "recorder", "operator_page"])
def test_service_starts_where_its_unit_forbids_it_to_make_code(name, tmp_path):
    unit = f"duralab-{name.removeprefix('operator_')}.service"
    assert "MemoryDenyWriteExecute=no" not in (SYSTEMD / unit).read_text()
    with duralab_bus.open_bus(service="hub") as hub:
        config = {"bus": {"connect": list(hub.listening)}, "exit_with_parent": True}
        if name == "recorder":
            config["folder"] = str(tmp_path / "recordings")
        if name == "operator_page":
            config |= {"folder": str(tmp_path / "page"), "port": 0}
        file = tmp_path / f"{name}.yaml"
        file.write_text(yaml.safe_dump(config))
        command = [sys.executable, "-c", _FORBID_NEW_CODE, name, "--config", str(file)]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        try:
            deadline = time.monotonic() + 100.0
            while (name, "main") not in hub.live() and process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.05)
            if process.poll() == 77:
                pytest.skip("this kernel cannot forbid it (Linux 6.3)")
            live = hub.live()
        finally:
            process.kill()
            process.communicate()
    assert (name, "main") in live
