"""Labs with a page, and a browser for it."""

import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# The browser and its protocol are those of the report's tests.
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "duralab" / "tests")]

from page_lab import PageLab  # noqa: E402


@pytest.fixture(scope="module")
def page_lab(tmp_path_factory):
    with PageLab(tmp_path_factory.mktemp("page_lab")) as started:
        yield started
