"""Mistakes at a running lab: one sentence that the page of error sentences has; and all places that raise an error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest

from ..judging import judge
from ..page import ROOT, elsewhere, places
from ..provoking import Provoked, needs_lab, provocations, provoke
from ..shared_files import SharedFiles
from ..shared_lab import shared_lab

ALL = provocations()


@pytest.fixture(scope="module")
def answer_to(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[int], Provoked]]:
    """Make a mistake of `ALL`, once, beside correct files and a lab with two shipped rigs."""
    shared = SharedFiles(tmp_path_factory.mktemp("shared") / "files")
    with shared_lab(tmp_path_factory.mktemp("lab")) as endpoint:

        @cache
        def answer(number: int) -> Provoked:
            one, folder = ALL[number], tmp_path_factory.mktemp("mistake")
            return provoke(one, folder, shared=shared, endpoint=endpoint if needs_lab(one) else None)

        yield answer


@pytest.mark.parametrize(
    "number",
    [pytest.param(n, id=one.run.replace("duralab ", "")) for n, one in enumerate(ALL) if needs_lab(one)],
)
def test_a_mistake_at_a_lab_is_answered_by_one_sentence_that_the_page_has(
    number: int, answer_to: Callable[[int], Provoked]
):
    judge(ALL[number], answer_to(number))


def test_every_place_that_raises_an_error_is_reached_by_a_mistake_or_accounted_for(
    answer_to: Callable[[int], Provoked],
):
    raised = {place for number in range(len(ALL)) for place in answer_to(number).raised_at}
    unreached = {
        (path, lines): source
        for (path, lines), source in places().items()
        if not any((path, line) in raised for line in lines)
    }
    table = elsewhere()
    unaccounted = [
        f"{path}:{lines.start}"
        for (path, lines), source in unreached.items()
        if not any(one.source in source for one in table.get(path, []))
    ]
    assert unaccounted == []
    stale = [
        f"{path}: {one.source}"
        for path, entries in table.items()
        for one in entries
        if not any(path == of and one.source in source for (of, _), source in unreached.items())
        or not (ROOT / one.test).is_file()
    ]
    assert stale == []
