"""Every block of the tutorials is run as written; `documented.py` says how."""

from __future__ import annotations

from pathlib import Path

import pytest
from documented import pages_that_run, run_page


# On a busy machine a page with several campaigns takes minutes.
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", pages_that_run("docs/tutorials/"))
def test_every_block_of_a_page_runs(page: str, request: pytest.FixtureRequest, tmp_path: Path):
    run_page(page, request, tmp_path)
