"""Every block of the tutorials is run as written; `documented.py` says how. Prints what each command of a page took."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from documented import pages_that_run, run_page


# On a busy machine a page with several campaigns takes minutes.
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", pages_that_run("docs/tutorials/"))
def test_every_block_of_a_page_runs(
    page: str, request: pytest.FixtureRequest, tmp_path: Path, record_property: Callable[[str, object], None]
):
    seconds = run_page(page, request, tmp_path)
    lines = [f"{taken:6.1f} s  {' '.join(command.split())[:90]}" for command, taken in seconds.items()]
    record_property("printed", "\n".join(["", *lines, f"{sum(seconds.values()):6.1f} s  {page}, all commands"]))
