"""Each notebook of the documentation runs in a kernel of its own, and prints what is stored in it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted(ROOT.glob("docs/tutorials/notebooks/*.ipynb"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
SECONDS = 40
"""What each may take on an idle machine of two cores; printed, and no verdict here."""


def cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def printed(cell: dict[str, Any]) -> str:
    return "".join("".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")


def pictures(cell: dict[str, Any]) -> int:
    return sum("image/png" in output.get("data", {}) for output in cell["outputs"])


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_prints_what_is_stored_in_it(notebook: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "nbconvert", "--to", "notebook", "--execute", "--output-dir", tmp_path, notebook],
        env={
            **os.environ,
            "IPYTHONDIR": str(tmp_path / "ipython"),
            "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    with capsys.disabled():
        sys.stdout.write(f"\n{notebook.stem}: {time.monotonic() - began:.0f} s (of {SECONDS} s)\n")
    for stored, run in zip(cells(notebook), cells(tmp_path / notebook.name), strict=True):
        assert pictures(stored) == pictures(run)
        assert NUMBER.sub("#", printed(run)) == NUMBER.sub("#", printed(stored))
        wanted, found = ([float(value) for value in NUMBER.findall(printed(cell))] for cell in (stored, run))
        # Another processor sums in another order.
        np.testing.assert_allclose(found, wanted, rtol=0.02, atol=0.002)


def test_the_notebooks_hold_outputs_and_no_trace_of_a_machine():
    assert len(NOTEBOOKS) == 3
    for notebook in NOTEBOOKS:
        assert sum(map(pictures, cells(notebook))) >= 1
        assert "/tmp/" not in notebook.read_text(encoding="utf-8")
