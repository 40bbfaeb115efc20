"""The whole table, member by key by operation, tried over a router with the configuration that the commands write."""

from __future__ import annotations

import re
from collections.abc import Iterable

import pytest

from duralab.security import read_refusals
from duralab.security.router_log import Refusal
from duralab_proto.access import Operation, permits
from duralab_proto.keys import Keys

from .access_trials import Trial, all_trials, run_trials, token_key
from .members import TRIED
from .secured_router import ROOT, SecuredRouter

LOGGED = {
    Operation.ASK: "Query",
    Operation.SERVE: "Declare Queryable",
    Operation.PUBLISH: "Put",
    Operation.RECEIVE: "Declare Subscriber",
    Operation.HOLD: "Liveliness Token",
    Operation.WATCH: "Declare Liveliness Subscriber",
}


@pytest.fixture(scope="module")
def came(router: SecuredRouter, certificates) -> set[Trial]:
    return run_trials(router.endpoint, certificates, expected=expected())


def expected() -> set[Trial]:
    return {trial for trial in all_trials(Keys()) if permits(trial.member, trial.operation, trial.key, Keys())}


def _logged(trial: Trial) -> tuple[str, str, str]:
    key = token_key(trial.key, trial.member) if trial.operation is Operation.HOLD else trial.key
    return trial.member.common_name, LOGGED[trial.operation], key


def _refused(refusals: Iterable[Refusal]) -> set[tuple[str, str, str]]:
    return {(each.who, each.what, each.key) for each in refusals}


def _deleted(refusals: Iterable[Refusal]) -> set[str]:
    return {each.who for each in refusals if each.what == "Delete"}


def test_everything_the_table_allows_comes_through(came):
    assert sorted(map(str, expected() - came)) == []


def test_nothing_else_comes_through(came):
    assert sorted(map(str, came - expected())) == []


def test_the_page_counts_the_cells_as_they_were_tried():
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    allowed, tried = len(expected()), len(all_trials(Keys()))
    counts = re.search(r"each of its (\d+) cells\..* (\d+) were admitted and (\d+) refused", page, re.DOTALL)
    assert counts, "the page does not count the cells"
    assert [int(count) for count in counts.groups()] == [tried, allowed, tried - allowed]


def test_every_refusal_is_logged_with_who_which_session_and_what(came, router):
    tried = {_logged(trial) for trial in set(all_trials(Keys())) - expected()}
    every = router.refusals(lambda refused: tried <= _refused(refused))
    assert sorted(tried - _refused(every)) == []
    logged = [refusal for refusal in every if refusal.what != "join"]
    refused = _refused(logged)
    assert {member.common_name for member in TRIED} == {who for who, _, _ in refused}
    assert all(refusal.session and refusal.time for refusal in logged)


def test_what_is_allowed_is_not_logged_as_refused(came, router):
    allowed = {_logged(trial) for trial in expected()}
    assert sorted(_refused(read_refusals(router.lines())) & allowed) == []


def test_a_deletion_is_refused_to_everyone(came, router):
    everyone = {member.common_name for member in TRIED}
    assert _deleted(router.refusals(lambda refused: everyone <= _deleted(refused))) == everyone
