"""The images: pinned, small, nobody's root, and holding no secret."""

import importlib.util
import re
import subprocess
import sys

import pytest

from .compose_file import DOCKERFILE, ROOT, compose_document, image_environment, stages

STAGES = stages()
IMAGES = ("rig_sim", "file_rig", "identifier", "iterator", "sequencer", "recorder", "operator_page", "viewer", "sweep")


@pytest.fixture(scope="module")
def closure():
    specification = importlib.util.spec_from_file_location("closure", ROOT / "deploy/images/closure.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module.closure


def test_every_image_comes_from_a_pinned_origin():
    origins = {stage.origin for stage in STAGES.values()} - set(STAGES)
    assert origins
    assert [
        origin for origin in origins if not re.fullmatch(r"docker\.io/library/[a-z]+:\d+\.\d+\.\d+-[a-z-]+", origin)
    ] == []


@pytest.mark.parametrize("image", IMAGES)
def test_every_image_is_run_by_a_user_without_rights(image):
    stage, users = STAGES[image], []
    while True:
        users = [*stage.values("USER"), *users]
        if stage.origin not in STAGES:
            break
        stage = STAGES[stage.origin]
    assert users == ["10001:10001"]
    assert STAGES["run"].instructions.index(("USER", "10001:10001")) > 0


@pytest.mark.parametrize("image", IMAGES)
def test_an_image_takes_nothing_from_its_build_but_what_is_installed(image):
    copies = STAGES[image].values("COPY")
    assert copies
    assert all(copy.startswith(f"--from=build-{image} /opt/duralab") for copy in copies)
    assert STAGES[image].values("RUN") == []


def test_no_secret_and_no_download_stands_in_the_dockerfile():
    text = DOCKERFILE.read_text()
    assert re.findall(r"(?i)password|token|api_key|\.key\b|https?://|curl|wget|\bADD\b", text) == []
    ignored = (DOCKERFILE.with_name("Dockerfile.dockerignore")).read_text().splitlines()
    # Everything is left out first.
    assert next(line for line in ignored if not line.startswith("#")) == "*"
    assert {"**/*.key", "**/*.crt", "**/tests"} <= set(ignored)
    let_in = {line[1:] for line in ignored if line.startswith("!")}
    taken = {word for copy in STAGES["build"].values("COPY") for word in copy.split()[:-1]}
    assert taken <= let_in


def test_everything_from_outside_is_checked_against_the_lock():
    script = (ROOT / "deploy/images/install.sh").read_text()
    installs = re.findall(r"pip\"? install(?:[^\n]*\\\n)*[^\n]*", script)
    assert len(installs) == 3
    assert [
        line for line in installs if "--require-hashes" not in line and "--verify-hashes --constraint" not in line
    ] == []
    subprocess.run(["sh", "-n", ROOT / "deploy/images/install.sh"], check=True)


@pytest.mark.parametrize("image", [image for image in IMAGES if image not in ("viewer", "sweep")])
def test_a_service_holds_itself_and_libraries_only(image, closure):
    folders = closure([f"services/{image}"])
    assert [folder for folder in folders if folder.startswith("services/")] == [f"services/{image}"]
    assert {"libs/bus", "proto"} <= set(folders)
    # The page is a client of the lab, by the SDK.
    assert ("duralab" in folders) == (image == "operator_page")
    (installed,) = STAGES[f"build-{image}"].values("RUN")
    assert re.sub(r'[\[\]",]', "", installed).startswith(f"deploy/images/install.sh services/{image}")


def test_folder_that_is_no_distribution_is_named(closure):
    with pytest.raises(LookupError, match="no distribution in services/nobody"):
        closure(["services/nobody"])


def test_compose_starts_what_the_images_start():
    services = compose_document({"DURALAB_CERTIFICATES": "certificates"})["services"]
    built = {service["build"]["target"]: service for service in services.values() if "build" in service}
    assert set(built) == set(IMAGES) - {"sweep"}
    for target, service in built.items():
        (entry,) = STAGES[target].values("ENTRYPOINT")
        assert str(service["entrypoint"]).replace("'", '"') == entry
        assert service["user"] == "10001:10001"
        assert service["image"].startswith(f"duralab/{target}:")
    assert image_environment(STAGES["recorder"], STAGES)["HOME"] == "/tmp"


def test_router_has_the_version_of_the_clients():
    pinned = re.search(r"(?m)^eclipse-zenoh==(\S+)", (ROOT / "requirements.lock").read_text())
    assert pinned is not None
    assert compose_document({"DURALAB_CERTIFICATES": "c"})["services"]["router"]["image"].endswith(f"zenoh:{pinned[1]}")
    assert f"zenoh, newTag: {pinned[1]}" in (ROOT / "deploy/kustomization.yaml").read_text()


def test_closure_is_printed_for_the_shell():
    script = ROOT / "deploy/images/closure.py"
    printed = subprocess.run(
        [sys.executable, script, "services/identifier"], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert printed == [
        "libs/bus",
        "libs/drive_map",
        "libs/loads",
        "libs/settings",
        "libs/spectra",
        "proto",
        "services/identifier",
    ]


def test_folders_of_volumes_belong_to_the_user_of_the_image():
    # A named volume takes its owner from the folder of the image; where there is none, root has it.
    (made,) = [run for run in STAGES["run"].values("RUN") if "install --directory" in run]
    folders = {f"/var/lib/{word}" for word in made.partition("install --directory")[2].split() if "duralab" in word}
    document = compose_document({"DURALAB_CERTIFICATES": "/certificates"})
    mounted = [volume.split(":") for service in document["services"].values() for volume in service.get("volumes", [])]
    kept = {target for source, target in mounted if source in document["volumes"] and target.startswith("/var/lib/")}
    assert "/var/lib/duralab/held" in kept
    assert kept <= folders
