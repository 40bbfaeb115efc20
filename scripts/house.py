"""Print the size of each package of the product: files, lines, folders, and upward or circular imports.

`python scripts/house.py` ends with 1 if there is an upward or circular import, or if a folder has more than 25
modules. Layers are those of the contracts in `pyproject.toml`, which `lint-imports` checks too. The goal for the lines
of the product is printed, met or not.
"""

from __future__ import annotations

import sys
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[1]
LARGEST_FOLDER = 25
GOAL_LINES = 60_000


@dataclass(frozen=True)
class Row:
    """Numbers of one package."""

    package: str
    files: int
    lines: int
    folders: int
    largest_folder: int
    up: tuple[str, ...]
    circles: tuple[str, ...]


def product_packages() -> dict[str, Path]:
    """Return the folder of each package in a wheel, without generated modules."""
    packages: dict[str, Path] = {}
    for manifest in sorted([*ROOT.glob("*/pyproject.toml"), *ROOT.glob("*/*/pyproject.toml")]):
        wheel = tomllib.loads(manifest.read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
        packages |= {name: manifest.parent / name for name in wheel["packages"]}
    return packages


def arrows(graph: grimp.ImportGraph, folder: str) -> dict[str, set[str]]:
    """Return the imported siblings of each module or folder directly in a folder."""
    found: dict[str, set[str]] = {child: set() for child in graph.find_children(folder)}
    for child, imports in found.items():
        inside = {child, *graph.find_descendants(child)}
        for module in inside:
            for imported in graph.find_modules_directly_imported_by(module):
                if imported.startswith(f"{folder}.") and imported not in inside:
                    imports.add(".".join(imported.split(".")[: folder.count(".") + 2]))
    return found


def circles(found: dict[str, set[str]]) -> tuple[str, ...]:
    """Return one import cycle among siblings as text, or an empty tuple."""
    try:
        TopologicalSorter(found).prepare()
    except CycleError as error:
        return (" -> ".join(error.args[1]),)
    return ()


def upward(found: dict[str, set[str]], layers: list[str], folder: str) -> tuple[str, ...]:
    """Return the imports among siblings that run against the layers of a contract, the top layer first."""
    height = {f"{folder}.{name.strip('( )')}": -row for row, layer in enumerate(layers) for name in layer.split("|")}
    height = {name.replace(" ", ""): row for name, row in height.items()}
    return tuple(
        f"{importer} -> {imported}"
        for importer, others in sorted(found.items())
        for imported in sorted(others)
        if importer in height and imported in height and height[imported] > height[importer]
    )


def rows() -> list[Row]:
    """Return the numbers of each package, by name."""
    packages = product_packages()
    graph = grimp.build_graph(*packages, cache_dir=None)
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = {
        folder: contract["layers"]
        for contract in contracts
        if contract["type"] == "layers"
        for folder in contract["containers"]
    }
    result: list[Row] = []
    for package, path in packages.items():
        files = [file for file in path.rglob("*.py") if not file.stem.endswith("_pb2")]
        side_by_side: defaultdict[Path, int] = defaultdict(int)
        for file in files:
            side_by_side[file.parent] += file.name != "__init__.py"
        up: list[str] = []
        turning: list[str] = []
        for folder in [package, *graph.find_descendants(package)]:
            found = arrows(graph, folder)
            turning += circles(found)
            up += upward(found, layers.get(folder, []), folder)
        lines = sum(file.read_text(encoding="utf-8").count("\n") for file in files)
        largest = max(side_by_side.values())
        result.append(Row(package, len(files), lines, len(side_by_side) - 1, largest, tuple(up), tuple(turning)))
    return result


def main() -> int:
    """Print the table, then the broken rules; return the exit code."""
    found = rows()
    said = [f"{'package':20}{'files':>7}{'lines':>8}{'folders':>9}{'largest folder':>16}{'up':>5}{'circles':>9}"]
    said += [
        f"{row.package:20}{row.files:7}{row.lines:8}{row.folders:9}{row.largest_folder:16}{len(row.up):5}"
        f"{len(row.circles):9}"
        for row in found
    ]
    files, lines = sum(row.files for row in found), sum(row.lines for row in found)
    verdict = "met" if lines <= GOAL_LINES else f"missed by {lines - GOAL_LINES}"
    said += [f"{'all':20}{files:7}{lines:8}", f"The goal is {GOAL_LINES} lines or less: {verdict}."]
    broken = [f"The import {arrow} runs up." for row in found for arrow in row.up]
    broken += [f"The imports {circle} run in a circle." for row in found for circle in row.circles]
    broken += [
        f"A folder of {row.package} has {row.largest_folder} modules side by side; {LARGEST_FOLDER} are allowed."
        for row in found
        if row.largest_folder > LARGEST_FOLDER
    ]
    sys.stdout.write("\n".join([*said, *broken]) + "\n")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
