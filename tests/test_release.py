"""The release: one version from a tag, exact pins, lower bounds that are tested, and a changelog with every change."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version as installed_version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
MANIFESTS = sorted([*ROOT.glob("*/pyproject.toml"), *ROOT.glob("*/*/pyproject.toml")])


def script(name):
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        specification = importlib.util.spec_from_file_location(f"release_{name}", ROOT / "scripts" / f"{name}.py")
        module = importlib.util.module_from_spec(specification)
        sys.modules[module.__name__] = module
        specification.loader.exec_module(module)
    finally:
        sys.path.remove(str(ROOT / "scripts"))
    return module


@pytest.fixture(scope="module")
def versions():
    return script("version")


@pytest.fixture(scope="module")
def dist():
    return script("dist")


@pytest.fixture(scope="module")
def changelog():
    return script("changelog")


def projects():
    return {manifest.parent: tomllib.loads(manifest.read_text(encoding="utf-8"))["project"] for manifest in MANIFESTS}


def requirements(project):
    extras = project.get("optional-dependencies", {})
    return [Requirement(text) for group in (project["dependencies"], *extras.values()) for text in group]


@pytest.mark.parametrize(
    ("described", "version"),
    [
        ("v1.2.3-0-g0a1b2c3", "1.2.3"),
        ("v1.2.3rc1-0-g0a1b2c3", "1.2.3rc1"),
        ("v1.2.3-7-g0a1b2c3", "1.2.4.dev7+g0a1b2c3"),
        ("v1.2.3-0-g0a1b2c3-dirty", "1.2.4.dev0+g0a1b2c3.dirty"),
        ("v1.2.3rc1-7-g0a1b2c3", "1.2.3rc2.dev7+g0a1b2c3"),
    ],
)
def test_version_follows_the_tag(versions, described, version):
    found = versions.version_of_description(described)
    assert found == version
    assert str(Version(found)) == found
    # What comes after a tag is newer than the tag's release.
    assert Version(found) >= Version(described.split("-")[0])


def test_tag_that_is_no_version_is_named(versions):
    with pytest.raises(ValueError, match=r"^The tag 'v1.2' is not a version; a release's tag is v1\.2\.3"):
        versions.version_of_description("v1.2-3-g0a1b2c3")


def test_given_version_holds_and_a_wrong_one_is_refused(versions, monkeypatch):
    monkeypatch.setenv("DURALAB_VERSION", "3.2.1")
    assert versions.version() == "3.2.1"
    monkeypatch.setenv("DURALAB_VERSION", "newest")
    with pytest.raises(ValueError, match=r"^DURALAB_VERSION is 'newest'; give a version"):
        versions.version()


def git(folder, *arguments):
    identity = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    subprocess.run(["git", "-C", folder, *identity, *arguments], check=True, capture_output=True)


def test_a_source_without_git_or_tags_has_a_development_version(versions, tmp_path, monkeypatch):
    monkeypatch.delenv("DURALAB_VERSION", raising=False)
    monkeypatch.setattr(versions, "ROOT", tmp_path)
    coming = ".".join(map(str, versions.NEXT))
    assert versions.version() == f"{coming}.dev0"
    git(tmp_path, "init", "--quiet")
    assert versions.version() == f"{coming}.dev0"
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", "first")
    assert re.fullmatch(rf"{re.escape(coming)}\.dev1\+g[0-9a-f]{{7}}", versions.version())
    git(tmp_path, "tag", "v2.0.0")
    assert versions.version() == "2.0.0"


def test_all_distributions_take_their_version_from_the_tag_and_are_installed_with_one():
    for folder, project in projects().items():
        assert project["dynamic"] == ["version"], folder
    assert len({installed_version(project["name"]) for project in projects().values()}) == 1


def test_released_manifest_pins_the_other_distributions_and_nothing_else(dist):
    for manifest in MANIFESTS:
        released = tomllib.loads(dist.released_manifest(manifest.read_text(encoding="utf-8"), "9.8.7"))
        assert released["project"]["version"] == "9.8.7"
        assert "version" not in released["tool"]["hatch"]
        for requirement in requirements(released["project"]):
            pinned = str(requirement.specifier) == "==9.8.7"
            assert pinned == requirement.name.startswith("duralab"), requirement
    with pytest.raises(ValueError, match=r"take the version from scripts/version\.py"):
        dist.released_manifest('[project]\nname = "a"\nversion = "1"\n', "9.8.7")


def test_every_dependency_has_a_lower_bound_that_the_lock_meets_and_no_other():
    lock = dict(re.findall(r"(?m)^([a-z0-9-]+)==([^\s;\\]+)", (ROOT / "requirements.lock").read_text()))
    bounds: dict[str, set[str]] = {}
    for project in projects().values():
        for requirement in requirements(project):
            if not requirement.name.startswith("duralab"):
                assert [part.operator for part in requirement.specifier] == [">="], requirement
                bounds.setdefault(requirement.name, set()).add(str(requirement.specifier))
                assert requirement.specifier.contains(lock[requirement.name]), requirement
    assert {name: bound for name, bound in bounds.items() if len(bound) != 1} == {}


def test_the_lab_extra_brings_every_service_and_the_client_none():
    found = projects()
    services = {project["name"] for folder, project in found.items() if folder.parent.name == "services"}
    client = found[ROOT / "duralab"]
    assert {Requirement(text).name for text in client["optional-dependencies"]["lab"]} == services
    needed, waiting = set(), ["duralab"]
    by_name = {project["name"]: project for project in found.values()}
    while waiting:
        name = waiting.pop()
        needed.add(name)
        waiting += [
            Requirement(text).name
            for text in by_name.get(name, {"dependencies": []})["dependencies"]
            if Requirement(text).name not in needed
        ]
    assert needed & (services | {"drake", "rerun-sdk", "llvmlite"}) == set()


def test_a_lab_without_its_services_names_the_extra(monkeypatch):
    from duralab.errors import LabError
    from duralab.processes import supervisor

    monkeypatch.setattr(supervisor, "find_spec", lambda name: None if name == "rig_sim" else object())
    supervisor.require_services("recorder")
    with pytest.raises(LabError, match=r"has no rig_sim, .* install the services with pip install 'duralab\[lab\]'"):
        supervisor.require_services("recorder", "rig_sim")


def test_deployed_images_are_those_of_the_coming_release(versions):
    coming = ".".join(map(str, versions.NEXT))
    compose = (ROOT / "deploy/compose/compose.yaml").read_text()
    assert set(re.findall(r"DURALAB_VERSION:-([^}]*)}", compose)) == {coming}
    assert set(re.findall(r"duralab/\w+, newTag: ([^}]*)}", (ROOT / "deploy/kustomization.yaml").read_text())) == {
        coming
    }


def test_changelog_has_the_form_and_a_wrong_one_is_named(changelog):
    assert changelog.faults((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) == []
    released = "## [Unreleased]\n## [1.2.3] - 2026-11-30\n### Added\n"
    assert changelog.faults(released) == []
    for text, said in {
        released.replace("Added", "New"): "Line 3 has the kind 'New'; use one of Added",
        released.replace("2026-11-30", "30.11.2026"): "Line 2 has the date '30.11.2026'",
        released.replace("1.2.3", "1.2"): "Line 2 has the version '1.2'",
        released.replace("## [Unreleased]\n", ""): "The first section is not",
        released + released.partition("\n")[2]: "1.2.3 has more than one section",
        released + "## [1.3.0] - 2026-12-01\n": "The releases are not in order",
        released + "## 1.0\n": "Line 4 is '## 1.0'",
    }.items():
        assert [sentence for sentence in changelog.faults(text) if sentence.startswith(said)], (text, said)


def test_branch_that_changes_what_users_see_needs_a_note(changelog, tmp_path):
    module = tmp_path / "duralab/duralab/errors.py"
    module.parent.mkdir(parents=True)
    git(tmp_path, "init", "--quiet", "--initial-branch", "main")
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", "first")
    git(tmp_path, "checkout", "--quiet", "-b", "work")

    def commit(path, message):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(message)
        git(tmp_path, "add", "--all")
        git(tmp_path, "commit", "--quiet", "--message", message)

    commit(tmp_path / "duralab/tests/test_errors.py", "Test errors")
    commit(tmp_path / "docs/errors.md", "Describe errors")
    assert changelog.commits_without_note("main", root=tmp_path) == []
    commit(module, "Name errors\n\nChangelog: none")
    assert changelog.commits_without_note("main", root=tmp_path) == []
    commit(module, "Rename an error")
    assert [line.partition(" ")[2] for line in changelog.commits_without_note("main", root=tmp_path)] == [
        "Rename an error"
    ]
    commit(tmp_path / "CHANGELOG.md", "Add a note")
    assert changelog.commits_without_note("main", root=tmp_path) == []


def test_citation_file_has_what_the_format_requires():
    content = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    # Required keys of the Citation File Format 1.2.0, and an author by either kind of name.
    assert {"cff-version", "message", "title", "authors"} <= content.keys()
    assert content["cff-version"] == "1.2.0"
    assert content["type"] == "software"
    assert content["license"] == projects()[ROOT / "duralab"]["license"]
    assert content["authors"]
    assert all({"name"} <= author.keys() or {"family-names"} <= author.keys() for author in content["authors"])
    known = {"cff-version", "message", "title", "type", "authors", "abstract", "keywords", "license", "references"}
    assert content.keys() <= known


def test_hooks_before_a_commit_call_targets_that_exist():
    content = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.M))
    (local,) = content["repos"]
    # Local hooks alone: nothing is fetched.
    assert local["repo"] == "local"
    for hook in local["hooks"]:
        program, *flags, target = hook["entry"].split()
        assert (program, flags, hook["language"]) == ("make", ["--no-print-directory"], "system")
        assert target in targets
