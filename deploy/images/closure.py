"""Which distributions of this repository does one need? `closure.py FOLDER[EXTRA] …` prints their folders."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def projects() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return folder and `[project]` of every distribution of this repository, by its name."""
    found = {}
    for manifest in sorted([*ROOT.glob("*/pyproject.toml"), *ROOT.glob("*/*/pyproject.toml")]):
        project = tomllib.loads(manifest.read_text(encoding="utf-8"))["project"]
        found[project["name"]] = (str(manifest.parent.relative_to(ROOT)), project)
    return found


def closure(wanted: Iterable[str]) -> list[str]:
    """Return the folders of distributions and of all that they need, themselves included, by name.

    Raises
    ------
    LookupError
        No distribution is in such a folder.
    """
    known = projects()
    by_folder = {folder: name for name, (folder, _) in known.items()}
    needed: set[str] = set()
    waiting: list[str] = []
    for folder in wanted:
        if folder.partition("[")[0] not in by_folder:
            raise LookupError(f"There is no distribution in {folder}; there are {', '.join(sorted(by_folder))}.")
        waiting.append(by_folder[folder.partition("[")[0]])
    while waiting:
        name = waiting.pop()
        if name in needed:
            continue
        needed.add(name)
        dependencies = (re.split(r"[\s\[<>=!~;]", text, maxsplit=1)[0] for text in known[name][1]["dependencies"])
        waiting += [dependency for dependency in dependencies if dependency in known]
    return sorted(known[name][0] for name in needed)


if __name__ == "__main__":
    sys.stdout.write("\n".join(closure(sys.argv[1:])) + "\n")
