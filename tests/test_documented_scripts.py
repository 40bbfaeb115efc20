"""Every Python block of the pages below is run as written, in an empty folder, against a real lab."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import duralab

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    "README.md",
    "docs/contract.md",
    "docs/guides/identification.md",
    "docs/guides/iteration.md",
    "services/identifier/README.md",
)
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


@pytest.mark.parametrize(
    "text", re.findall(r"```yaml\n(.*?)```", (ROOT / "docs/guides/iteration.md").read_text(), flags=re.S)
)
def test_a_documented_part_of_a_campaign_file_fits_into_one(text: str, tmp_path: Path):
    shipped = Path(duralab.__file__).with_name("campaigns") / "front_axle_demo.yaml"
    part = yaml.safe_load(text)
    path = tmp_path / "campaign.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(shipped.read_text()) | part))
    loaded = duralab.load_campaign(path).model_dump(mode="json")
    for key, section in part.items():
        if isinstance(section, dict):
            assert section.keys() <= loaded[key].keys()
        else:
            assert loaded[key] == section
