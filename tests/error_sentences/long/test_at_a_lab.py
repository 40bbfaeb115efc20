"""Mistakes at a running lab: one sentence with the value and what to do, as the page of error sentences has it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ..judging import judge
from ..provoking import Provocation, needs_lab, provocations, provoke
from ..shared_files import SharedFiles
from ..shared_lab import shared_lab


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> SharedFiles:
    """Correct files, made when they are needed."""
    return SharedFiles(tmp_path_factory.mktemp("shared") / "files")


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A lab with two shipped rigs."""
    with shared_lab(tmp_path_factory.mktemp("lab")) as endpoint:
        yield endpoint


@pytest.mark.parametrize(
    "one", [one for one in provocations() if needs_lab(one)], ids=lambda one: one.run.replace("duralab ", "")
)
def test_a_mistake_at_a_lab_is_answered_by_one_sentence_that_the_page_has(
    one: Provocation, shared: SharedFiles, endpoint: str, tmp_path: Path
):
    judge(one, provoke(one, tmp_path, shared=shared, endpoint=endpoint))
