"""Mutation testing itself: which changes are made to a module, and that its tests then meet the changed one."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

QUALITY = Path(__file__).resolve().parents[2] / "scripts" / "quality"
sys.path.insert(0, str(QUALITY))

from mutants import mutants, mutated  # noqa: E402

MODULE = '''"""What it is."""


def clipped(value: float, largest: float = 2.0) -> float:
    if not value < largest:
        raise ValueError(f"{value + 1} is beyond {largest}.")
    return max(value, -largest) + 1
'''


@pytest.fixture
def module(tmp_path):
    path = tmp_path / "changed.py"
    path.write_text(MODULE)
    return path


def test_each_change_is_one_and_refusals_and_annotations_are_left_alone(module):
    found = mutants(module)
    assert [mutant.change for mutant in found] == [
        "2.0  →  4.0",
        "not value < largest  →  value < largest",
        "value < largest  →  value <= largest",
        "max(value, -largest) + 1  →  max(value, -largest) - 1",
        "max(value, -largest)  →  min(value, -largest)",
        "-largest  →  largest",
        "1  →  2",
    ]
    plain = ast.unparse(ast.parse(MODULE)).splitlines()
    for mutant in found:
        changed = ast.unparse(mutated(mutant)).splitlines()
        assert [before != after for before, after in zip(plain, changed, strict=True)].count(True) == 1
        assert changed[4] == plain[4], "what is said in a refusal"


def test_an_import_finds_the_mutant_and_the_file_stays_as_it_is(module):
    script = (
        "import sys; from pathlib import Path; from mutants import install, mutants; path = Path('changed.py')\n"
        "install(mutants(path)[-1], 'changed'); import changed; print(changed.clipped(1.0))"
    )
    told = subprocess.run(
        [sys.executable, "-c", script],
        cwd=module.parent,
        env={"PYTHONPATH": str(QUALITY), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout == "3.0\n"
    assert module.read_text() == MODULE
