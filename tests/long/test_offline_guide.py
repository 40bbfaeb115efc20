"""The guide to recordings, block by block: what it shows is what it prints."""

from __future__ import annotations

import io
import re
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pytest

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "offline_analysis.md"
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?(?![\w])")
TOLERANCE = 0.1


@pytest.fixture(scope="module")
def folder(lab, tmp_path_factory):
    made = tmp_path_factory.mktemp("guide")
    lab.run("front_axle_demo", out=made / "demo")
    return made


def test_every_block_prints_what_the_guide_shows(folder):
    blocks = re.findall(r"```python\n(.*?)```\n```text\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.S)
    assert len(blocks) == 6
    names: dict[str, object] = {}
    for script, shown in blocks:
        printed = io.StringIO()
        with chdir(folder), redirect_stdout(printed):
            exec(compile(script, GUIDE.name, "exec"), names)
        assert NUMBER.sub("#", " ".join(printed.getvalue().split())) == NUMBER.sub("#", " ".join(shown.split()))
        found, expected = ([float(number) for number in NUMBER.findall(text)] for text in (printed.getvalue(), shown))
        # Two digits were rounded to the last one that is shown.
        assert found == pytest.approx(expected, rel=TOLERANCE, abs=0.015)


def test_every_picture_of_the_guide_is_there():
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", GUIDE.read_text(encoding="utf-8"))
    assert len(pictures) == 4
    for picture in pictures:
        assert (GUIDE.parent / picture).is_file(), picture
