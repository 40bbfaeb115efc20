"""Every block of the READMEs and the pages that stand alone is run as written; `documented.py` says how."""

from __future__ import annotations

from pathlib import Path

import pytest
from documented import pages_that_run, run_page

FOLDERS = ("", "docs/README.md", "docs/contract.md", "docs/rigs/", "docs/theory/", "docs/reference/")


# On a busy machine a page with several campaigns takes minutes.
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", pages_that_run(*FOLDERS))
def test_every_block_of_a_page_runs(page: str, request: pytest.FixtureRequest, tmp_path: Path):
    run_page(page, request, tmp_path)
