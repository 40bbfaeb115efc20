"""The access table: a row for every key of the contract, and no way around it."""

import inspect

import pytest

from duralab_proto.access import (
    ACCESS,
    Effect,
    Holder,
    HolderNameError,
    KeyKind,
    Operation,
    Role,
    effect_of,
    permits,
    reserved,
)
from duralab_proto.keys import Keys

KEYS = Keys("lab")
# Methods of the key space that make no key of the bus.
NO_KEYS = {"within"}


def test_every_key_of_the_contract_has_a_row():
    methods = {name for name, _ in inspect.getmembers(KEYS, inspect.ismethod) if not name.startswith("_")}
    assert methods - NO_KEYS == {row.method for row in ACCESS}


def test_every_row_gives_a_key_of_this_lab_and_says_who_owns_it():
    for row in ACCESS:
        assert row.expression(KEYS).startswith("duralab/v1/lab/")
        assert row.owners or row.users
        assert row.kind.owner_operation is not row.kind.user_operation


def test_every_query_is_a_read_or_a_change_and_only_these_are_changes():
    queries = [row for row in ACCESS if row.kind is KeyKind.QUERY]
    assert {row.effect for row in queries} == set(Effect)
    assert {row.effect for row in ACCESS if row.kind is not KeyKind.QUERY} == {None}
    # Not from the table: what the contract says that each does.
    moving = ("rig_play", "rig_stop", "rig_reset", "identify", "identify_levels")
    storing = ("campaign_start", "campaign_stop", "campaign_resume", "commit")
    changing = {row.method for row in queries if row.effect is Effect.CHANGE}
    assert changing == {*moving, *storing}
    for row in queries:
        key = row.expression(KEYS).replace("*", "a")
        assert effect_of(key, KEYS) is row.effect


def test_the_narrower_key_and_what_is_outside_the_contract_are_taken_for_changes():
    assert effect_of(KEYS.campaign("a"), KEYS) is Effect.READ
    assert effect_of(KEYS.campaign_start(), KEYS) is Effect.CHANGE
    for key in ("duralab/v1/other/rig/a/state", "duralab/v1/lab/rig/a/state/more", KEYS.rig_signal("a", "b")):
        assert effect_of(key, KEYS) is Effect.CHANGE


def test_only_an_operator_clears_a_latch_and_starts_campaigns():
    for key in (KEYS.rig_reset("a"), KEYS.campaign_start(), KEYS.campaign_stop("a"), KEYS.campaign_resume("a")):
        assert [role for role in Role if permits(role, Operation.ASK, key, KEYS)] == [Role.OPERATOR]


def test_a_viewer_only_watches():
    may = {
        (operation, row.expression(KEYS))
        for row in ACCESS
        for operation in Operation
        if row.permits(Role.VIEWER, operation)
    }
    assert {operation for operation, _ in may} == {Operation.ASK, Operation.RECEIVE, Operation.WATCH, Operation.HOLD}
    assert [key for operation, key in may if operation is Operation.HOLD] == [KEYS.asking("*")]
    moving = ("play", "stop", "reset", "identify", "levels", "start", "resume", "commit", "@replay", "@mark")
    assert [key for operation, key in may if operation is Operation.ASK and key.rpartition("/")[2] in moving] == []


def test_what_an_expression_also_matches_is_not_given_away_with_it():
    assert permits(Role.VIEWER, Operation.ASK, KEYS.campaign("a"), KEYS)
    assert not permits(Role.VIEWER, Operation.ASK, KEYS.campaign_start(), KEYS)
    assert KEYS.campaign_start() in reserved(Role.VIEWER, Operation.ASK, KEYS)
    assert reserved(Role.OPERATOR, Operation.ASK, KEYS) == []


@pytest.mark.parametrize("role", list(Role))
@pytest.mark.parametrize(
    "key", ["duralab/v1/other/rig/a/state", "duralab/v1/lab/rig/a/state/more", "duralab/v1/lab/rig", "@/x/router", "**"]
)
def test_what_stands_in_no_row_is_forbidden_to_all(role, key):
    assert not any(permits(role, operation, key, KEYS) for operation in Operation)


def test_nobody_speaks_for_a_service_that_it_is_not():
    for row in ACCESS:
        assert len(row.owners) <= 1 or row.method == "asking"


def test_a_holder_is_a_role_and_a_name():
    assert Holder.parse("operator.anna") == Holder("operator", "anna")
    assert Holder("rig", "front-axle").common_name == "rig.front-axle"


@pytest.mark.parametrize(
    "name", ["operator", "boss.anna", "operator.", "operator.Anna", "operator.a b", "operator." + "a" * 59]
)
def test_a_common_name_that_is_no_holder_is_refused_in_one_sentence(name):
    with pytest.raises(HolderNameError) as caught:
        Holder.parse(name)
    assert str(caught.value).count(". ") == 0
