"""Every place of the SDK that raises an error is reached: by a mistake, or by a unit test that a table names."""

from __future__ import annotations

from ..page import ROOT, all_said, elsewhere, places


def test_every_place_that_raises_an_error_is_reached_by_a_mistake_or_accounted_for():
    raised = {place for _, answer in all_said() for place in answer.raised_at}
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
