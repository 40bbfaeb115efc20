"""Mutation testing: make a small change in a module, run the module's tests, and report undetected changes.

No file is changed: a child, forked before any import of the project, replaces the module by the mutant and runs pytest.
The mutants are drawn with a seed, so that results can be reproduced.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import resource
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from mutants import Mutant, install, mutants

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "out" / "mutation.json"
SPARE_SECONDS = 30
"""Extra processor time of a mutant, beyond three times the time of all tests without a change."""


@dataclass(frozen=True)
class Area:
    """Modules to mutate, and the tests that should detect the mutants.

    Parameters
    ----------
    root : str
        Folder of the distribution, which contains its package.
    modules : tuple of str
        Patterns of the modules below it.
    tests : tuple of str
        Names of test files in its `tests`, the quickest first, without `test_` and `.py`.
    """

    root: str
    modules: tuple[str, ...]
    tests: tuple[str, ...]


AREAS = {
    "estimators": Area(
        "services/identifier",
        ("identifier/estimators/*.py",),
        (
            "layout",
            "local_neighbourhoods",
            "bad_records",
            "smoothing_check",
            "where_peers_err",
            "local_estimators",
            "spectral_estimators",
            "uncertainty",
            "rig_under_test",
        ),
    ),
    "updates": Area(
        "services/iterator",
        tuple(
            f"iterator/{name}.py"
            for name in (
                "updates/basic_twr",
                "band/banded_transform",
                "updates/adaptive_modelling",
                "updates/model_correction",
                "updates/anchored_fit",
                "updates/drive_squares",
                "updates/secant_fit",
                "updates/secant_update",
                "model/step_spectra",
                "updates/segment_acceptance",
                "model/inversion",
            )
        ),
        (
            "segment_acceptance",
            "step_spectra",
            "adaptive_modelling",
            "full_and_backward_corrections",
            "where_peers_err",
            "rig_model",
            "banded_transform",
            "drive_squares",
            "secant_update",
            "gains_and_weights",
            "iteration_loop",
        ),
    ),
    "codec": Area("libs/drive_files", ("duralab_drive_files/rpc3_*.py",), ("rpc3_reading", "rpc3_writing")),
}


def main() -> int:
    """Test mutants of the given areas; surviving mutants are findings, not failures."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("areas", nargs="*", metavar="AREA", help=f"of {', '.join(AREAS)}; all where none is named")
    asked.add_argument("--sample", type=int, default=30, help="mutants of each area (30)")
    asked.add_argument("--seed", type=int, default=1, help="that they are drawn with (1)")
    asked.add_argument("--again", action="store_true", help="only those that survived the last time")
    options = asked.parse_args()
    for library in ("numpy", "scipy.signal", "scipy.linalg", "pytest"):
        importlib.import_module(library)  # once, before the children are forked
    RESULTS.parent.mkdir(exist_ok=True)
    known = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
    for name in options.areas or AREAS:
        before = known.get(name, {}).get("survived", []) if options.again else None
        known[name] = _try(name, AREAS[name], sample=options.sample, seed=options.seed, only=before)
        RESULTS.write_text(json.dumps(known, indent=1, ensure_ascii=False), encoding="utf-8")
    return 0


def _try(name: str, area: Area, *, sample: int, seed: int, only: list[dict] | None) -> dict:
    every = [mutant for path in _modules(area) for mutant in mutants(path)]
    if only is None:
        random.Random(seed).shuffle(every)
        chosen = every[:sample]
    else:
        wanted = {(entry["path"], entry["number"], entry["change"]) for entry in only}
        chosen = [mutant for mutant in every if (_place(mutant.path), mutant.number, mutant.change) in wanted]
    code, seconds = _tested(area, mutant=None, seconds=600)
    if code != 0:
        raise SystemExit(f"The tests of {name} fail without any change (pytest ends with {code}); correct them first.")
    _say(f"{name}: {len(chosen)} of {len(every)} mutants; the tests take {seconds:.0f} s of processor time")
    survived = []
    for mutant in chosen:
        code, taken = _tested(area, mutant=mutant, seconds=3 * seconds + SPARE_SECONDS)
        fate = "survived" if code == 0 else "killed"
        _say(f"{fate:8}  {taken:5.1f} s  {_place(mutant.path)}:{mutant.line}: {mutant.change}")
        if code == 0:
            survived.append({**asdict(mutant), "path": _place(mutant.path)})
    _say(f"{name}: {len(chosen) - len(survived)} killed, {len(survived)} survived")
    return {"mutants": len(every), "tried": len(chosen), "seed": seed, "survived": survived}


def _tested(area: Area, *, mutant: Mutant | None, seconds: float) -> tuple[int, float]:
    """Run the tests of an area in a child; return pytest's exit code, or a signal, and its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        _be_tested(area, mutant, int(seconds))
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return status, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _be_tested(area: Area, mutant: Mutant | None, seconds: int) -> None:
    code = 99
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        os.chdir(ROOT)
        if mutant is not None:
            place = mutant.path.relative_to(ROOT / area.root).with_suffix("")
            install(mutant, ".".join(place.parts))
        with tempfile.TemporaryDirectory() as folder:
            os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = folder
            tests = [str(next(Path(area.root, "tests").rglob(f"test_{name}.py"))) for name in area.tests]
            code = int(sys.modules["pytest"].main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
    finally:
        os._exit(code)


def _modules(area: Area) -> list[Path]:
    found = {path for pattern in area.modules for path in (ROOT / area.root).glob(pattern)}
    return sorted(path for path in found if path.name != "__init__.py")


def _place(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
