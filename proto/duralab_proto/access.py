"""Access rights on the bus: a table of the key space, from which the router's access control is made.

A member's role determines the operations, its rigs or its project the keys (`members.py`). The table has a row for
every key of the contract, which a test checks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache, partial
from itertools import product
from typing import Final

from duralab_proto.keys import ANY, MAIN_INSTANCE, Keys
from duralab_proto.members import Member, Role


class Operation(StrEnum):
    """Operation on a key."""

    ASK = "ask"
    """Send a query and receive its answer."""
    SERVE = "serve"
    """Receive queries on it and answer them."""
    PUBLISH = "publish"
    """Publish messages on it."""
    RECEIVE = "receive"
    """Subscribe to its messages."""
    HOLD = "hold"
    """Declare it as a liveliness token."""
    WATCH = "watch"
    """Watch the liveliness tokens on it."""


class KeyKind(StrEnum):
    """Kind of a key, which determines its two operations."""

    QUERY = "query"
    STREAM = "stream"
    LIVELINESS = "liveliness"

    @property
    def owner_operation(self) -> Operation:
        """Operation of its owners."""
        return _OPERATIONS[self][0]

    @property
    def user_operation(self) -> Operation:
        """Operation of its users."""
        return _OPERATIONS[self][1]


class Effect(StrEnum):
    """Effect of a query on the lab, which determines whether a client may repeat it after a lost connection."""

    READ = "read"
    """Moves and changes nothing, so it may be repeated."""
    CHANGE = "change"
    """Moves a rig, or starts, changes or stores something; never repeated."""
    STOP = "stop"
    """Brings a rig to rest; never repeated, and allowed for every operator, also for one bound to other rigs."""


READ_SECONDS: Final = 60.0
"""Longest time, in seconds, to the answer of a read from its service's memory."""

LONG_READ_SECONDS: Final = 6 * 3600.0
"""Longest time, in seconds, to the answer of a read for which its service computes or reads recordings."""

WORK_SECONDS: Final = 30 * 24 * 3600.0
"""Longest time, in seconds, to the answer of any query: a playback may wait for a person."""

_OPERATIONS: Final = {
    KeyKind.QUERY: (Operation.SERVE, Operation.ASK),
    KeyKind.STREAM: (Operation.PUBLISH, Operation.RECEIVE),
    KeyKind.LIVELINESS: (Operation.HOLD, Operation.WATCH),
}


class Slot(StrEnum):
    """Kind of object that a name in a key refers to."""

    RIG = "rig"
    CAMPAIGN = "campaign"
    """A campaign or an endurance test, or a recording of it."""
    RUN = "run"
    MODEL = "model"
    PROJECT = "project"
    OTHER = "other"


@dataclass(frozen=True)
class KeyAccess:
    """Row of the table.

    Parameters
    ----------
    method : str
        Method of `Keys` that makes the key.
    kind : KeyKind
        Kind of the key.
    names : tuple of str
        Arguments of the method: a name, or a `Slot` if the row is about all names.
    owners : tuple of Role
        Roles that serve, publish or hold it.
    users : tuple of Role
        Roles that query, receive or watch it.
    suffix : str
        Suffix after the key of the method.
    bulk : bool
        Whether a query on it may be larger than `SMALL_QUERY_BYTES`.
    effect : Effect or None
        Effect of a query on it; None for a key without queries.
    any_project : bool
        Whether it reads from every project, which is not allowed for a member bound to one.
    longest_seconds : float
        Longest time to the answer of a query on it, if its client states none; see `longest_seconds_of`.
    """

    method: str
    kind: KeyKind
    names: tuple[str, ...]
    owners: tuple[Role, ...]
    users: tuple[Role, ...]
    suffix: str = ""
    bulk: bool = False
    effect: Effect | None = None
    any_project: bool = False
    longest_seconds: float = WORK_SECONDS

    def expression(self, keys: Keys) -> str:
        """Return the expression of all keys of the row."""
        names = (ANY if isinstance(name, Slot) else name for name in self.names)
        return f"{getattr(keys, self.method)(*names)}{self.suffix}"

    def permits(self, role: Role, operation: Operation) -> bool:
        """Return whether some member of a role may do an operation on some keys of this row."""
        owns = operation is self.kind.owner_operation and role in self.owners
        return owns or (operation is self.kind.user_operation and role in self.users)

    def expressions(self, member: Member, operation: Operation, keys: Keys) -> list[str]:
        """Return the expressions of the keys of this row on which a member may do an operation."""
        may = member.role in set(Role) and self.permits(Role(member.role), operation)
        if not may or (self.any_project and member.project):
            return []
        bound = self._bound(member, operation)
        slots = (name for name in self.names if isinstance(name, Slot))
        chunks = self.expression(keys).split("/")
        allowed = [bound.get(next(slots), (ANY,)) if chunk == ANY else (chunk,) for chunk in chunks]
        return ["/".join(each) for each in product(*allowed)]

    def _bound(self, member: Member, operation: Operation) -> Mapping[Slot, tuple[str, ...]]:
        """Return the names that a member is bound to."""
        if member.role == Role.RIG and operation is not Operation.ASK:
            return {Slot.RIG: member.rigs}
        if member.role == Role.OPERATOR and member.rigs and self.effect is Effect.CHANGE:
            return {Slot.RIG: member.rigs}
        if project := member.project:
            named = f"{project}-{_REST}"
            return {Slot.CAMPAIGN: (project, named), Slot.RUN: (f"{project}.{_REST}", named), Slot.PROJECT: (project,)}
        return {}


# Wildcard for the rest of a name in Zenoh's key expressions.
_REST: Final = "$*"

SMALL_QUERY_BYTES: Final = 1024 * 1024
"""Largest query, attachment included, on a key whose requests carry no record; the router drops a larger one."""

EVERYONE: Final = tuple(Role)
_SERVICES: Final = (Role.RIG, Role.IDENTIFIER, Role.ITERATOR, Role.SEQUENCER, Role.RECORDER)
_PEOPLE: Final = (Role.OPERATOR, Role.VIEWER)


def _asked(
    method: str,
    *names: str,
    served_by: Role,
    by: tuple[Role, ...],
    effect: Effect,
    bulk: bool = False,
    any_project: bool = False,
    longest_seconds: float = WORK_SECONDS,
) -> KeyAccess:
    return KeyAccess(
        method,
        KeyKind.QUERY,
        names,
        (served_by,),
        by,
        bulk=bulk,
        effect=effect,
        any_project=any_project,
        longest_seconds=longest_seconds,
    )


_reads = partial(_asked, effect=Effect.READ, longest_seconds=READ_SECONDS)
_reads_long = partial(_asked, effect=Effect.READ, longest_seconds=LONG_READ_SECONDS)
_changes = partial(_asked, effect=Effect.CHANGE)
_stops = partial(_asked, effect=Effect.STOP)


def _streamed(method: str, *names: str, by: Role, to: tuple[Role, ...]) -> tuple[KeyAccess, ...]:
    """Return the rows of a stream: the stream, its replay and head, and the recorder's mark.

    A viewer may not request a replay, because one query is answered with up to a thousand messages.
    """
    repaired_for = tuple(role for role in to if role is not Role.VIEWER)
    replay, head = (
        KeyAccess(method, KeyKind.QUERY, names, (by,), repaired_for, suffix, effect=Effect.READ)
        for suffix in ("/@replay", "/@head")
    )
    return (
        KeyAccess(method, KeyKind.STREAM, names, (by,), to),
        replay,
        head,
        KeyAccess(method, KeyKind.STREAM, names, (Role.RECORDER,), (by,), "/@mark"),
    )


def _present(service: str, instance: str, role: Role) -> tuple[KeyAccess, ...]:
    """Return the rows of a service's presence: its token, and its health, for people and the health check."""
    return (
        KeyAccess("live", KeyKind.LIVELINESS, (service, instance), (role,), ()),
        _reads("health", service, instance, served_by=role, by=EVERYONE),
    )


_PLANNERS: Final = (Role.ITERATOR, Role.OPERATOR)
_COMMANDERS: Final = (Role.IDENTIFIER, Role.ITERATOR, Role.SEQUENCER, Role.OPERATOR)
_WRITERS: Final = (Role.ITERATOR, Role.SEQUENCER)
_CAMPAIGNERS: Final = (Role.SEQUENCER, Role.OPERATOR)

ACCESS: Final[tuple[KeyAccess, ...]] = (
    # Rigs. A member that commands a rig may stop it; clearing a latch is a person's decision.
    _reads("rig_description", Slot.RIG, served_by=Role.RIG, by=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    _reads_long("rig_frf", Slot.RIG, served_by=Role.RIG, by=(*_COMMANDERS, Role.VIEWER), bulk=True),
    _changes("rig_play", Slot.RIG, served_by=Role.RIG, by=_COMMANDERS, bulk=True),
    _stops("rig_stop", Slot.RIG, served_by=Role.RIG, by=_COMMANDERS),
    _changes("rig_reset", Slot.RIG, served_by=Role.RIG, by=(Role.OPERATOR,)),
    _reads("rig_state", Slot.RIG, served_by=Role.RIG, by=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_state", Slot.RIG, by=Role.RIG, to=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_signal", Slot.RIG, Slot.RUN, by=Role.RIG, to=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_pose", Slot.RIG, by=Role.RIG, to=(Role.RECORDER, *_PEOPLE)),
    # The identifier. An experiment moves a rig, so viewers are excluded.
    _changes("identify", Slot.RIG, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads_long("experiment_plan", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _changes("identify_levels", Slot.RIG, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads_long("level_advice", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads("model", Slot.MODEL, served_by=Role.IDENTIFIER, by=(Role.ITERATOR, *_PEOPLE), any_project=True),
    _reads_long("prediction", Slot.MODEL, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads_long("convergence", Slot.MODEL, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    # The iterator. The sequencer requests corrections of an event's drive.
    _changes("campaign_start", Slot.RIG, served_by=Role.ITERATOR, by=_CAMPAIGNERS, bulk=True),
    _reads("campaign", Slot.CAMPAIGN, served_by=Role.ITERATOR, by=(Role.SEQUENCER, *_PEOPLE)),
    _stops("campaign_stop", Slot.CAMPAIGN, served_by=Role.ITERATOR, by=_CAMPAIGNERS),
    _changes("campaign_resume", Slot.CAMPAIGN, Slot.RIG, served_by=Role.ITERATOR, by=(Role.OPERATOR,), bulk=True),
    _changes("campaign_decide", Slot.CAMPAIGN, Slot.RIG, served_by=Role.ITERATOR, by=(Role.OPERATOR,), bulk=True),
    *_streamed("campaign_event", Slot.CAMPAIGN, by=Role.ITERATOR, to=(Role.RECORDER, *_PEOPLE)),
    _changes("pre_test", Slot.RIG, served_by=Role.ITERATOR, by=(Role.OPERATOR,)),
    # The sequencer. Holding an endurance test brings its rig to rest, as stopping it does.
    _changes("endurance_start", Slot.RIG, served_by=Role.SEQUENCER, by=(Role.OPERATOR,), bulk=True),
    _reads("endurance", Slot.CAMPAIGN, served_by=Role.SEQUENCER, by=_PEOPLE),
    _stops("endurance_stop", Slot.CAMPAIGN, served_by=Role.SEQUENCER, by=(Role.OPERATOR,)),
    _stops("endurance_hold", Slot.CAMPAIGN, served_by=Role.SEQUENCER, by=(Role.OPERATOR,)),
    _changes("endurance_resume", Slot.CAMPAIGN, Slot.RIG, served_by=Role.SEQUENCER, by=(Role.OPERATOR,)),
    _changes("endurance_decide", Slot.CAMPAIGN, Slot.RIG, served_by=Role.SEQUENCER, by=(Role.OPERATOR,)),
    *_streamed("endurance_event", Slot.CAMPAIGN, by=Role.SEQUENCER, to=(Role.RECORDER, *_PEOPLE)),
    # The recorder. Only iterator and sequencer write; verification reads whole files, which is expensive.
    _changes("commit", served_by=Role.RECORDER, by=_WRITERS, bulk=True),
    _reads_long("recordings", served_by=Role.RECORDER, by=(*_WRITERS, *_PEOPLE), any_project=True),
    _reads_long("project_recordings", Slot.PROJECT, served_by=Role.RECORDER, by=_PEOPLE),
    _reads_long("recording", Slot.CAMPAIGN, served_by=Role.RECORDER, by=(*_WRITERS, *_PEOPLE)),
    _reads_long("recording_read", Slot.CAMPAIGN, served_by=Role.RECORDER, by=_PEOPLE),
    _reads_long("recording_steps", Slot.CAMPAIGN, served_by=Role.RECORDER, by=(*_WRITERS, *_PEOPLE)),
    _reads_long("recording_signals", Slot.CAMPAIGN, served_by=Role.RECORDER, by=_PEOPLE),
    _reads_long("recording_verify", Slot.CAMPAIGN, served_by=Role.RECORDER, by=(Role.OPERATOR,)),
    # Presence: each service holds its token, every member sees all tokens.
    *_present("rig_sim", Slot.RIG, Role.RIG),
    *_present("identifier", MAIN_INSTANCE, Role.IDENTIFIER),
    *_present("iterator", MAIN_INSTANCE, Role.ITERATOR),
    *_present("sequencer", MAIN_INSTANCE, Role.SEQUENCER),
    *_present("recorder", MAIN_INSTANCE, Role.RECORDER),
    # A client of the lab, with a separate operator's certificate.
    *_present("operator_page", MAIN_INSTANCE, Role.OPERATOR),
    KeyAccess("live", KeyKind.LIVELINESS, (Slot.OTHER, Slot.OTHER), (), EVERYONE),
    # Waiting clients: held by all roles, watched by the services.
    KeyAccess("asking", KeyKind.LIVELINESS, (Slot.OTHER,), EVERYONE, _SERVICES),
)
"""Table of access rights; an operation in no row is forbidden."""


def permits(member: Member, operation: Operation, key: str, keys: Keys) -> bool:
    """Return whether a member may do an operation on a key.

    Parameters
    ----------
    member : Member
        Member, from its certificate.
    operation : Operation
        Operation to check.
    key : str
        Key or key expression; one outside the contract is forbidden to all.
    keys : Keys
        Keys of the lab.
    """
    return any(covers(expression, key) for row in ACCESS for expression in row.expressions(member, operation, keys))


def effect_of(key: str, keys: Keys) -> Effect:
    """Return the effect of a query on the lab; a query outside the contract counts as a change.

    Parameters
    ----------
    key : str
        A key without wildcards.
    keys : Keys
        Keys of the lab.
    """
    return next((row.effect for row in _query_rows(key, keys.lab) if row.effect is not None), Effect.CHANGE)


def longest_seconds_of(key: str, keys: Keys) -> float:
    """Return the longest time to the answer of a query, in seconds, regardless of progress reports.

    A bus keeps the memory of a query until then, also after its answer, so frequent queries have a short time.

    Parameters
    ----------
    key : str
        A key without wildcards.
    keys : Keys
        Keys of the lab.
    """
    return max((row.longest_seconds for row in _query_rows(key, keys.lab)), default=WORK_SECONDS)


# A client uses the same few keys repeatedly, and twice for each query.
@lru_cache(maxsize=256)
def _query_rows(key: str, lab: str) -> tuple[KeyAccess, ...]:
    keys = Keys(lab)
    return tuple(row for row in ACCESS if row.kind is KeyKind.QUERY and covers(row.expression(keys), key))


def covers(expression: str, key: str) -> bool:
    """Return whether an expression of the table, with "*" and "$*" in names, matches a key or a narrower expression."""
    parts, chunks = expression.split("/"), key.split("/")
    return len(parts) == len(chunks) and all(map(_matches, parts, chunks))


def _matches(part: str, chunk: str) -> bool:
    if part.endswith(_REST):
        return chunk.startswith(part.removesuffix(_REST))
    return part == chunk or (part == ANY and not chunk.startswith("@"))
