"""Line coverage of the pure cores by their unit tests: a table, and an error if a core has less than nine tenths.

A module that imports `duralab_bus` is part of a service's thin shell, which is tested by processes on a real bus. It
does not count here, nor do the tests that need a bus (`*_on_the_bus.py`).
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LEAST_PERCENT = 90.0


@dataclass(frozen=True)
class Core:
    """Package whose lines are counted, with its unit tests.

    Parameters
    ----------
    package : str
        Name of the package.
    folder : str
        Folder of its sources.
    tests : tuple of str
        Folders or file patterns of its tests.
    """

    package: str
    folder: str
    tests: tuple[str, ...]


CORES = {
    **{
        f"duralab_{name}": Core(f"duralab_{name}", f"libs/{name}/duralab_{name}", (f"libs/{name}/tests",))
        for name in ("spectra", "roads", "loads", "drive_files")
    },
    "duralab_recordings": Core(
        "duralab_recordings",
        "libs/recordings/duralab_recordings",
        (
            "libs/recordings/tests",
            "duralab/tests/long/test_damaged_recordings.py",
            *(f"duralab/tests/test_{name}.py" for name in ("signal_windows", "recording_parts")),
        ),
    ),
    "duralab_settings": Core("duralab_settings", "libs/settings/duralab_settings", ("libs/settings/tests",)),
    **{
        name: Core(name, f"services/{name}/{name}", (f"services/{name}/tests",))
        for name in ("identifier", "iterator", "rig_sim")
    },
    "motion": Core(
        # Named by its parent, which coverage finds without an import; numpy can be imported only once in a process.
        "duralab_gateway",
        "libs/gateway/duralab_gateway/motion",
        (
            "libs/gateway/tests",
            *(f"services/rig_sim/tests/test_{name}.py" for name in ("approach", "player", "poses", "watchdogs")),
        ),
    ),
    "formats": Core(
        "duralab.formats",
        "duralab/duralab/formats",
        (
            "duralab/tests/long/test_convert.py",
            "duralab/tests/long/test_formats_fuzz.py",
            *(
                f"duralab/tests/test_{name}.py"
                for name in (
                    "foreign_files",
                    "formats",
                    "formats_guide",
                    "uff58",
                    "units",
                )
            ),
        ),
    ),
}


def main() -> int:
    """Measure the given cores; return 1 if the coverage of one is too low."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("cores", nargs="*", metavar="CORE", help=f"of {', '.join(CORES)}; all where none is named")
    asked.add_argument("--lines", action="store_true", help="name the lines that no test runs")
    options = asked.parse_args()
    short = []
    _say("| core | modules | lines | run | share |\n|---|---|---|---|---|")
    for name in options.cores or CORES:
        files = _measured(CORES[name])
        lines = sum(file["summary"]["num_statements"] for file in files.values())
        run = sum(file["summary"]["covered_lines"] for file in files.values())
        percent = 100.0 * run / lines
        _say(f"| `{name}` | {len(files)} | {lines} | {run} | {percent:.1f} % |")
        if percent < LEAST_PERCENT:
            short.append(f"{name} ({percent:.1f} %)")
        if options.lines:
            for path, file in sorted(files.items()):
                if file["missing_lines"]:
                    _say(f"    {path}: {', '.join(map(str, file['missing_lines']))}")
    if short:
        sys.stderr.write(f"Less than {LEAST_PERCENT:g} % of the lines are run in {', '.join(short)}; add tests.\n")
    return int(bool(short))


def _measured(core: Core) -> dict[str, dict]:
    """Run the unit tests of a core; return the coverage of each of its pure modules."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--ignore-glob=*_on_the_bus.py"]
        command += [f"--cov={core.package}", f"--cov-report=json:{report}", "--cov-report=", *core.tests]
        environment = {**os.environ, "COVERAGE_FILE": str(Path(folder, "data"))}
        tested = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if tested.returncode != 0:
            raise SystemExit(f"The tests of {core.package} fail:\n{tested.stdout[-4000:]}{tested.stderr[-1000:]}")
        files = json.loads(report.read_text(encoding="utf-8"))["files"]
    pure = {path.relative_to(ROOT).as_posix() for path in (ROOT / core.folder).rglob("*.py") if _is_pure(path)}
    return {path: file for path, file in files.items() if path in pure and file["summary"]["num_statements"]}


def _is_pure(path: Path) -> bool:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return "duralab_bus" not in names


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
