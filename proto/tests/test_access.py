"""The access table: a row for every key of the contract, and no way around it."""

import inspect

import pytest

from duralab_proto.access import (
    ACCESS,
    LONG_READ_SECONDS,
    READ_SECONDS,
    WORK_SECONDS,
    Effect,
    KeyKind,
    Operation,
    Slot,
    covers,
    effect_of,
    longest_seconds_of,
    permits,
)
from duralab_proto.keys import Keys
from duralab_proto.members import Member, Role

KEYS = Keys("lab")
# Methods of the key space that make no key of the bus.
NO_KEYS = {"within"}

FRONT = Member("rig", "front_axle", ("front_axle",))
ANNA = Member("operator", "anna")
BEN = Member("operator", "ben", ("front_axle", "beam"))
HALL = Member("viewer", "hall")
GUEST = Member("viewer", "guest", project="wheel")
SERVICES = tuple(Member(role, "main") for role in ("identifier", "iterator", "sequencer", "recorder"))
MEMBERS = (FRONT, *SERVICES, ANNA, BEN, HALL, GUEST)


def test_every_key_of_the_contract_has_a_row():
    methods = {name for name, _ in inspect.getmembers(KEYS, inspect.ismethod) if not name.startswith("_")}
    assert methods - NO_KEYS == {row.method for row in ACCESS}


def test_every_row_gives_a_key_of_this_lab_and_says_who_owns_it():
    for row in ACCESS:
        assert row.expression(KEYS).startswith("duralab/v1/lab/")
        assert row.owners or row.users
        assert row.kind.owner_operation is not row.kind.user_operation


def test_every_query_is_a_read_a_change_or_a_stop_and_only_these_are_no_reads():
    queries = [row for row in ACCESS if row.kind is KeyKind.QUERY]
    assert {row.effect for row in ACCESS if row.kind is not KeyKind.QUERY} == {None}
    # Not from the table: what the contract says that each does.
    moving = {"rig_play", "rig_reset", "identify", "identify_levels", "pre_test"}
    storing = {"campaign_start", "campaign_resume", "campaign_decide", "commit"}
    storing |= {"endurance_start", "endurance_resume", "endurance_decide"}
    effects = {effect: {row.method for row in queries if row.effect is effect} for effect in Effect}
    assert effects[Effect.CHANGE] == moving | storing
    assert effects[Effect.STOP] == {"rig_stop", "campaign_stop", "endurance_stop", "endurance_hold"}
    for row in queries:
        key = row.expression(KEYS).replace("*", "a")
        assert effect_of(key, KEYS) is row.effect


def test_what_is_polled_has_a_short_time_and_what_may_wait_for_a_person_a_long_one():
    polled = (KEYS.rig_state("a"), KEYS.campaign("a"), KEYS.endurance("a"), KEYS.health("iterator", "main"))
    assert {longest_seconds_of(key, KEYS) for key in polled} == {READ_SECONDS}
    # They go through whole recordings, or compute.
    long = (KEYS.recording("a"), KEYS.recordings(), KEYS.recording_verify("a"), KEYS.experiment_plan())
    assert {longest_seconds_of(key, KEYS) for key in long} == {LONG_READ_SECONDS}
    for row in ACCESS:
        if row.kind is KeyKind.QUERY and row.effect is not Effect.READ:
            assert longest_seconds_of(row.expression(KEYS).replace("*", "a"), KEYS) == WORK_SECONDS
    assert longest_seconds_of("duralab/v1/lab/rig/a/state/more", KEYS) == WORK_SECONDS


def test_what_is_outside_the_contract_is_taken_for_a_change():
    assert effect_of(KEYS.campaign("a"), KEYS) is Effect.READ
    assert effect_of(KEYS.campaign_start("a"), KEYS) is Effect.CHANGE
    for key in ("duralab/v1/other/rig/a/state", "duralab/v1/lab/rig/a/state/more", KEYS.rig_signal("a", "b")):
        assert effect_of(key, KEYS) is Effect.CHANGE


def test_only_an_operator_clears_a_latch_and_starts_campaigns_and_pre_tests():
    # "Iterate again" of an endurance test is a campaign, which the sequencer begins and ends.
    for key in (KEYS.campaign_start("beam"), KEYS.campaign_stop("a")):
        may = [member for member in MEMBERS if permits(member, Operation.ASK, key, KEYS)]
        assert [member for member in may if Role(member.role) is not Role.SEQUENCER] == [ANNA, BEN]
    keys = (
        KEYS.rig_reset("beam"),
        KEYS.campaign_resume("a", "beam"),
        KEYS.campaign_decide("a", "beam"),
        KEYS.pre_test("beam"),
    )
    for key in keys:
        assert [member for member in MEMBERS if permits(member, Operation.ASK, key, KEYS)] == [ANNA, BEN]


def test_whatever_an_operator_may_change_names_its_rig_in_the_key():
    # Access control sees nothing but the key: a command without the rig's name would go around the operator's binding.
    changes = [row for row in ACCESS if row.effect is Effect.CHANGE and row.permits(Role.OPERATOR, Operation.ASK)]
    assert changes
    for row in changes:
        assert Slot.RIG in row.names, row.method


def test_an_operator_bound_to_rigs_moves_only_these_and_stops_and_reads_all():
    for make in (
        KEYS.rig_play,
        KEYS.rig_reset,
        KEYS.identify,
        KEYS.identify_levels,
        KEYS.campaign_start,
        KEYS.pre_test,
    ):
        allowed = [rig for rig in ("front_axle", "beam", "other") if permits(BEN, Operation.ASK, make(rig), KEYS)]
        assert allowed == ["front_axle", "beam"]
    for key in (KEYS.rig_stop("other"), KEYS.campaign_stop("a"), KEYS.rig_state("other"), KEYS.recording_verify("a")):
        assert permits(BEN, Operation.ASK, key, KEYS)
    assert not permits(BEN, Operation.ASK, KEYS.rig_play("*"), KEYS)
    assert permits(ANNA, Operation.ASK, KEYS.rig_play("other"), KEYS)


def test_a_rig_speaks_for_its_rigs_only():
    for row in ACCESS:
        if Slot.RIG in row.names and Role.RIG in row.owners:
            for rig in ("front_axle", "beam"):
                key = row.expression(KEYS).replace("*", rig, 1)
                assert permits(FRONT, row.kind.owner_operation, key, KEYS) is (rig == "front_axle"), key
    assert not permits(FRONT, Operation.SERVE, KEYS.rig_play("*"), KEYS)
    assert not permits(FRONT, Operation.RECEIVE, f"{KEYS.rig_state('beam')}/@mark", KEYS)
    # Like everyone it sees who is there, and how they are.
    assert permits(FRONT, Operation.WATCH, KEYS.live("*", "*"), KEYS)
    assert permits(FRONT, Operation.ASK, KEYS.health("rig_sim", "beam"), KEYS)


def test_a_viewer_bound_to_a_project_reads_no_other():
    for make in (KEYS.campaign, KEYS.recording, KEYS.recording_read, KEYS.recording_steps, KEYS.recording_signals):
        for id, allowed in (
            ("wheel", True),
            ("wheel-2", True),
            ("wheels", False),
            ("other", False),
            ("other-wheel", False),
        ):
            assert permits(GUEST, Operation.ASK, make(id), KEYS) is allowed, make(id)
            assert permits(HALL, Operation.ASK, make(id), KEYS)
    runs = {"wheel.i01": True, "wheel-2.i01": True, "wheels.i01": False, "*": False}
    assert {run: permits(GUEST, Operation.RECEIVE, KEYS.rig_signal("a", run), KEYS) for run in runs} == runs
    assert permits(GUEST, Operation.ASK, KEYS.project_recordings("wheel"), KEYS)
    for key in (KEYS.project_recordings("other"), KEYS.recordings(), KEYS.model("a")):
        assert not permits(GUEST, Operation.ASK, key, KEYS)
        assert permits(HALL, Operation.ASK, key, KEYS)
    assert not permits(GUEST, Operation.RECEIVE, KEYS.campaign_event("*"), KEYS)


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


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.common_name)
@pytest.mark.parametrize("operation", [Operation.ASK, Operation.SERVE])
def test_what_an_expression_also_matches_is_not_given_away_with_it(member, operation):
    # `recording/list` is matched by `recording/*`: who may ask the one must be meant by the other too.
    expressions = [each for row in ACCESS for each in row.expressions(member, operation, KEYS)]
    for row in ACCESS:
        key = row.expression(KEYS).replace("*", "a")
        if row.kind is KeyKind.QUERY and not row.permits(Role(member.role), operation):
            assert not [expression for expression in expressions if covers(expression, key)]


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.common_name)
@pytest.mark.parametrize(
    "key", ["duralab/v1/other/rig/a/state", "duralab/v1/lab/rig/a/state/more", "duralab/v1/lab/rig", "@/x/router", "**"]
)
def test_what_stands_in_no_row_is_forbidden_to_all(member, key):
    assert not any(permits(member, operation, key, KEYS) for operation in Operation)


def test_the_router_and_who_reads_its_metrics_are_no_members_of_the_bus():
    for role in ("router", "admin"):
        member = Member(role, "main")
        assert not any(permits(member, each, row.expression(KEYS), KEYS) for each in Operation for row in ACCESS)


def test_nobody_speaks_for_a_service_that_it_is_not():
    for row in ACCESS:
        assert len(row.owners) <= 1 or row.method == "asking"
