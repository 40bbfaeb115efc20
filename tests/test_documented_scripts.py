"""Every Python block of the pages below is run as written, in an empty folder, against a real lab."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "docs/contract.md", "docs/guides/identification.md", "services/identifier/README.md")
BLOCKS = [
    (page, number, block)
    for page in PAGES
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.S), start=1)
]


@pytest.mark.parametrize(("page", "number", "block"), BLOCKS, ids=[f"{page}-{number}" for page, number, _ in BLOCKS])
def test_a_documented_script_runs(lab, page: str, number: int, block: str, tmp_path: Path):
    # The pages name the default port; tests use a free one.
    script = block.replace("tcp/127.0.0.1:7474", lab.endpoints[0])
    finished = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout
