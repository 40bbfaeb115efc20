"""Every block of the tutorials is run as written; `documented.py` says how. Prints what each command of a page took."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from documented import pages_that_run, run_page


# On a busy machine a page with several campaigns takes minutes.
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", pages_that_run("docs/tutorials/"))
def test_every_block_of_a_page_runs(
    page: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    seconds = run_page(page, request, tmp_path)
    with capsys.disabled():
        lines = [f"{taken:6.1f} s  {' '.join(command.split())[:90]}" for command, taken in seconds.items()]
        sys.stdout.write("\n".join(["", *lines, f"{sum(seconds.values()):6.1f} s  {page}, all commands", ""]))
