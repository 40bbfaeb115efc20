"""Print a table of the content sizes of each service's image, from the packages installed in .venv.

Each image contains only the service's distributions and the packages of requirements.lock that these need.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
IMAGES = {
    "rig_sim": ("duralab-rig-sim",),
    "file_rig": ("duralab-file-rig",),
    "identifier": ("duralab-identifier",),
    "iterator": ("duralab-iterator",),
    "sequencer": ("duralab-sequencer",),
    "recorder": ("duralab-recorder",),
    "operator_page": ("duralab-operator-page",),
    "sweep": (
        "duralab[sweeps]",
        "duralab-rig-sim",
        "duralab-file-rig",
        "duralab-identifier",
        "duralab-iterator",
        "duralab-recorder",
    ),
}
LARGEST_NAMED = 4
LEFT_OUT = {"recorder": ("rerun_cli/rerun",), "sweep": ("rerun_cli/rerun",)}
"""Files that the Dockerfile removes."""


def needed(wanted: Iterable[str]) -> dict[str, Distribution]:
    """Return all installed distributions that requirements need, on this machine, by their normalised names.

    Raises
    ------
    PackageNotFoundError
        A distribution is not installed.
    """
    found: dict[str, Distribution] = {}
    waiting = [Requirement(text) for text in wanted]
    seen: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        requirement = waiting.pop()
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        if (name, frozenset(requirement.extras)) in seen:
            continue
        seen.add((name, frozenset(requirement.extras)))
        found[name] = distribution(name)
        for text in found[name].requires or ():
            further = Requirement(text)
            extras = requirement.extras or {""}
            if further.marker is None or any(further.marker.evaluate({"extra": extra}) for extra in (*extras, "")):
                waiting.append(further)
    return found


def size_of(installed: Distribution, left_out: Iterable[str]) -> int:
    """Return the bytes of a distribution's files; for distributions of this repository, of their sources."""
    own = re.sub(r"[-_.]+", "_", installed.metadata["Name"]).lower()
    if own.startswith("duralab"):
        folder = _closure().projects()[installed.metadata["Name"]][0]
        return sum(path.stat().st_size for path in (ROOT / folder).glob("*/**/*") if _shipped(path))
    files = [path for path in installed.files or () if not path.name.endswith(".pyc")]
    kept = (path for path in files if not str(path).endswith(tuple(left_out)))
    return sum(place.stat().st_size for path in kept if (place := Path(str(path.locate()))).is_file())


def _shipped(path: Path) -> bool:
    return path.is_file() and "tests" not in path.parts and path.suffix != ".pyc"


def _closure() -> ModuleType:
    specification = importlib.util.spec_from_file_location("closure", ROOT / "deploy" / "images" / "closure.py")
    if specification is None or specification.loader is None:
        raise ImportError("deploy/images/closure.py is missing.")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def table() -> str:
    """Return the table in Markdown."""
    lines = ["| image | packages | MB | the largest |", "|---|---|---|---|"]
    for image, wanted in IMAGES.items():
        sizes = {name: size_of(each, LEFT_OUT.get(image, ())) for name, each in needed(wanted).items()}
        largest = sorted(sizes.items(), key=lambda item: -item[1])[:LARGEST_NAMED]
        named = ", ".join(f"{name} {size / 1e6:.0f}" for name, size in largest)
        lines.append(f"| `{image}` | {len(sizes)} | {sum(sizes.values()) / 1e6:.0f} | {named} |")
    files = distribution("rerun-sdk").files or ()
    viewer = next(Path(str(path.locate())) for path in files if str(path) == "rerun_cli/rerun")
    lines.append(f"| `viewer` | 0 | {viewer.stat().st_size / 1e6:.0f} | the program rerun |")
    return "\n".join(lines)


def main() -> int:
    """Print the table."""
    try:
        sys.stdout.write(table() + "\n")
    except PackageNotFoundError as error:
        sys.stderr.write(f"{error.name} is not installed here; run make setup.\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
