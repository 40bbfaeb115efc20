"""Whether the packages fit together: all there, one version of the lab, and those that were tested."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from duralab.diagnosis.finding import Finding, fine, problem, warning

OWN: Final = (
    "duralab",
    "duralab-proto",
    "duralab-bus",
    "duralab-gateway",
    "duralab-spectra",
    "duralab-roads",
    "duralab-drive-map",
    "duralab-loads",
    "duralab-settings",
    "duralab-rig-sim",
    "duralab-identifier",
    "duralab-iterator",
    "duralab-recorder",
)
"""Distributions of the lab itself."""

ON_THE_WIRE: Final = ("eclipse-zenoh", "protobuf")
"""Packages whose versions decide whether two machines understand each other."""

_MOST_SHOWN: Final = 5


def check_own_versions(installed: Mapping[str, str]) -> Finding:
    """Judge whether the lab's own distributions are of one version; `installed` has versions by names."""
    found = {name: installed[name] for name in OWN if name in installed}
    if len(set(found.values())) > 1:
        listed = ", ".join(f"{name} {version}" for name, version in found.items())
        return problem("versions", f"Parts of the lab are of different versions: {listed}.", "Install all of one.")
    return fine("versions", f"duralab {found.get('duralab', 'of no version')}, all parts alike")


def check_requirements(required: Iterable[str], installed: Mapping[str, str]) -> Finding:
    """Judge whether everything that the lab needs is there."""
    names = {_name(requirement) for requirement in required if "extra ==" not in requirement}
    missing = sorted(name for name in names if name not in installed)
    if missing:
        return problem(
            "packages",
            f"Not installed: {', '.join(missing)}.",
            "Run `make setup`, or install them into this Python.",
        )
    return fine("packages", f"all {len(names)} that the lab asks for are installed")


def check_lock(locked: Mapping[str, set[str]], installed: Mapping[str, str]) -> Finding:
    """Judge whether the packages are those that were tested."""
    if not locked:
        return fine("lock", "no requirements.lock beside this installation to compare with")
    others = {name: version for name, version in installed.items() if name in locked and version not in locked[name]}
    if not others:
        return fine("lock", f"{len(locked.keys() & installed.keys())} packages, all of the versions that were tested")
    wire = [name for name in ON_THE_WIRE if name in others]
    shown = [*wire, *(name for name in sorted(others) if name not in wire)][:_MOST_SHOWN]
    listed = ", ".join(f"{name} {others[name]} (tested: {', '.join(sorted(locked[name]))})" for name in shown)
    more = f" and {len(others) - len(shown)} more" if len(others) > len(shown) else ""
    judged = problem if wire else warning
    return judged("lock", f"Of other versions than tested: {listed}{more}.", "Run `make setup`.")


def locked_versions(text: str) -> dict[str, set[str]]:
    """Return the versions that the text of a requirements.lock allows, by names; one may have two, by Python."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"(?m)^([A-Za-z0-9._-]+)==([^\s;\\]+)", text):
        found.setdefault(_name(name), set()).add(version)
    return found


def _name(requirement: str) -> str:
    """Return the name in a requirement, as names are compared."""
    match = re.match(r"[A-Za-z0-9._-]+", requirement)
    return re.sub(r"[-_.]+", "-", match[0] if match else requirement).lower()


def named(versions: Iterable[tuple[str | None, str]]) -> dict[str, str]:
    """Return versions by names, as names are compared."""
    return {_name(name): version for name, version in versions if name}
