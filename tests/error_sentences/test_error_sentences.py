"""Mistakes without a lab: one sentence with the value and what to do, as the page of error sentences has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from .judging import judge
from .page import PAGE
from .provoking import Provocation, needs_lab, provocations, provoke
from .shared_files import SharedFiles

ALL = provocations()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> SharedFiles:
    """Correct files, made when they are needed."""
    return SharedFiles(tmp_path_factory.mktemp("shared") / "files")


@pytest.mark.parametrize(
    "one", [one for one in ALL if not needs_lab(one)], ids=lambda one: one.run.replace("duralab ", "")
)
def test_a_mistake_is_answered_by_one_sentence_that_the_page_has(one: Provocation, shared: SharedFiles, tmp_path: Path):
    judge(one, provoke(one, tmp_path, shared=shared, endpoint=None))


def test_the_page_has_no_sentence_that_nothing_provokes():
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `` ")]
    assert len(rows) == len(ALL)
