"""Who may do what on the bus: one table beside the key space, from which the router's access control is made.

A certificate's common name is `<role>.<name>`; the role says what its holder may do, the name says who it is. The table
has a row for every key of the contract; a test holds it to the key space.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Final

from duralab_proto.keys import ANY, MAIN_INSTANCE, Keys


class Role(StrEnum):
    """What a holder of a certificate is in the lab."""

    RIG = "rig"
    """Plays drives: the simulation, or the gateway to a real rig."""
    IDENTIFIER = "identifier"
    ITERATOR = "iterator"
    RECORDER = "recorder"
    OPERATOR = "operator"
    """A person or script that runs the lab: plays, starts and stops campaigns, clears latches."""
    VIEWER = "viewer"
    """A person or script that only watches."""


class Operation(StrEnum):
    """What can be done on a key."""

    ASK = "ask"
    """Send a query and receive its answer."""
    SERVE = "serve"
    """Receive the queries on it and answer them."""
    PUBLISH = "publish"
    """Put messages on it."""
    RECEIVE = "receive"
    """Subscribe to what is published on it."""
    HOLD = "hold"
    """Declare it as a liveliness token."""
    WATCH = "watch"
    """See who holds it."""


class KeyKind(StrEnum):
    """What travels on a key, and so which two operations it knows."""

    QUERY = "query"
    STREAM = "stream"
    LIVELINESS = "liveliness"

    @property
    def owner_operation(self) -> Operation:
        """What its owners do."""
        return _OPERATIONS[self][0]

    @property
    def user_operation(self) -> Operation:
        """What the others do that may use it."""
        return _OPERATIONS[self][1]


class Effect(StrEnum):
    """What a query does to the lab, and so whether a client may ask it again after its connection was lost."""

    READ = "read"
    """Moves nothing and changes nothing: asked twice, it does no more than asked once."""
    CHANGE = "change"
    """Moves a rig, or starts, ends, changes or stores something: never asked again."""


_OPERATIONS: Final = {
    KeyKind.QUERY: (Operation.SERVE, Operation.ASK),
    KeyKind.STREAM: (Operation.PUBLISH, Operation.RECEIVE),
    KeyKind.LIVELINESS: (Operation.HOLD, Operation.WATCH),
}


@dataclass(frozen=True)
class KeyAccess:
    """One row of the table.

    Parameters
    ----------
    method : str
        The method of `Keys` that makes the key.
    kind : KeyKind
        What travels on it.
    expression : callable
        Given the keys of a lab, returns the expression of all keys of the row.
    owners : tuple of Role
        Who serves, publishes or holds it.
    users : tuple of Role
        Who asks, receives or watches it.
    bulk : bool
        Whether a query on it may be larger than `SMALL_QUERY_BYTES`.
    effect : Effect or None
        What a query on it does; None for what is not a query.
    """

    method: str
    kind: KeyKind
    expression: Callable[[Keys], str]
    owners: tuple[Role, ...]
    users: tuple[Role, ...]
    bulk: bool = False
    effect: Effect | None = None

    def permits(self, role: Role, operation: Operation) -> bool:
        """Return whether a role may do an operation on the keys of this row."""
        owns = operation is self.kind.owner_operation and role in self.owners
        return owns or (operation is self.kind.user_operation and role in self.users)


SMALL_QUERY_BYTES: Final = 1024 * 1024
"""Largest query, attachment included, on a key whose requests carry no record; the router drops a larger one."""

EVERYONE: Final = tuple(Role)
_SERVICES: Final = (Role.RIG, Role.IDENTIFIER, Role.ITERATOR, Role.RECORDER)
_PEOPLE: Final = (Role.OPERATOR, Role.VIEWER)
_ANY_RUN: Final = (ANY, ANY)


def _asked(
    method: str,
    *names: str,
    served_by: Role,
    by: tuple[Role, ...],
    effect: Effect,
    bulk: bool = False,
) -> KeyAccess:
    def expression(keys: Keys) -> str:
        return str(getattr(keys, method)(*names))

    return KeyAccess(method, KeyKind.QUERY, expression, (served_by,), by, bulk, effect)


_reads = partial(_asked, effect=Effect.READ)
_changes = partial(_asked, effect=Effect.CHANGE)


def _streamed(method: str, *names: str, by: Role, to: tuple[Role, ...]) -> tuple[KeyAccess, ...]:
    """Return the rows of a stream: itself, its replay and head, and the recorder's mark.

    A viewer may ask for no replay: one question is answered with up to a thousand messages.
    """
    repaired_for = tuple(role for role in to if role is not Role.VIEWER)

    def beside(suffix: str) -> Callable[[Keys], str]:
        return lambda keys: f"{getattr(keys, method)(*names)}{suffix}"

    return (
        KeyAccess(method, KeyKind.STREAM, beside(""), (by,), to),
        KeyAccess(method, KeyKind.QUERY, beside("/@replay"), (by,), repaired_for, effect=Effect.READ),
        KeyAccess(method, KeyKind.QUERY, beside("/@head"), (by,), repaired_for, effect=Effect.READ),
        KeyAccess(method, KeyKind.STREAM, beside("/@mark"), (Role.RECORDER,), (by,)),
    )


def _present(service: str, instance: str, role: Role) -> tuple[KeyAccess, ...]:
    """Return the rows of a service's being there: its token, and how it is, for people and the check beside it."""
    return (
        KeyAccess("live", KeyKind.LIVELINESS, lambda keys: keys.live(service, instance), (role,), ()),
        _reads("health", service, instance, served_by=role, by=EVERYONE),
    )


_PLANNERS: Final = (Role.ITERATOR, Role.OPERATOR)
_COMMANDERS: Final = (Role.IDENTIFIER, Role.ITERATOR, Role.OPERATOR)

ACCESS: Final[tuple[KeyAccess, ...]] = (
    # Rigs. Whoever commands one may stop it; to clear a latch is a person's decision.
    _reads("rig_description", ANY, served_by=Role.RIG, by=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    _reads("rig_frf", ANY, served_by=Role.RIG, by=(*_COMMANDERS, Role.VIEWER), bulk=True),
    _changes("rig_play", ANY, served_by=Role.RIG, by=_COMMANDERS, bulk=True),
    _changes("rig_stop", ANY, served_by=Role.RIG, by=_COMMANDERS),
    _changes("rig_reset", ANY, served_by=Role.RIG, by=(Role.OPERATOR,)),
    _reads("rig_state", ANY, served_by=Role.RIG, by=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_state", ANY, by=Role.RIG, to=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_signal", *_ANY_RUN, by=Role.RIG, to=(*_COMMANDERS, Role.RECORDER, Role.VIEWER)),
    *_streamed("rig_pose", ANY, by=Role.RIG, to=(Role.RECORDER, *_PEOPLE)),
    # The identifier. An experiment moves a rig: not for who only watches.
    _changes("identify", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads("experiment_plan", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _changes("identify_levels", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads("level_advice", served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads("model", ANY, served_by=Role.IDENTIFIER, by=(Role.ITERATOR, *_PEOPLE)),
    _reads("prediction", ANY, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    _reads("convergence", ANY, served_by=Role.IDENTIFIER, by=_PLANNERS, bulk=True),
    # The iterator.
    _changes("campaign_start", served_by=Role.ITERATOR, by=(Role.OPERATOR,), bulk=True),
    _reads("campaign", ANY, served_by=Role.ITERATOR, by=_PEOPLE),
    _changes("campaign_stop", ANY, served_by=Role.ITERATOR, by=(Role.OPERATOR,)),
    _changes("campaign_resume", ANY, served_by=Role.ITERATOR, by=(Role.OPERATOR,), bulk=True),
    *_streamed("campaign_event", ANY, by=Role.ITERATOR, to=(Role.RECORDER, *_PEOPLE)),
    # The recorder. Only the iterator writes; to verify reads whole files, which costs.
    _changes("commit", served_by=Role.RECORDER, by=(Role.ITERATOR,), bulk=True),
    _reads("recordings", served_by=Role.RECORDER, by=(Role.ITERATOR, *_PEOPLE)),
    _reads("recording", ANY, served_by=Role.RECORDER, by=(Role.ITERATOR, *_PEOPLE)),
    _reads("recording_read", ANY, served_by=Role.RECORDER, by=_PEOPLE),
    _reads("recording_steps", ANY, served_by=Role.RECORDER, by=(Role.ITERATOR, *_PEOPLE)),
    _reads("recording_signals", ANY, served_by=Role.RECORDER, by=_PEOPLE),
    _reads("recording_verify", ANY, served_by=Role.RECORDER, by=(Role.OPERATOR,)),
    # Who is there: each holds its own, everyone sees all of them.
    *_present("rig_sim", ANY, Role.RIG),
    *_present("identifier", MAIN_INSTANCE, Role.IDENTIFIER),
    *_present("iterator", MAIN_INSTANCE, Role.ITERATOR),
    *_present("recorder", MAIN_INSTANCE, Role.RECORDER),
    KeyAccess("live", KeyKind.LIVELINESS, lambda keys: keys.live(ANY, ANY), (), EVERYONE),
    # Who waits for an answer: held by all, seen by those who answer.
    KeyAccess("asking", KeyKind.LIVELINESS, lambda keys: keys.asking(ANY), EVERYONE, _SERVICES),
)
"""Who may do what. What stands in no row is forbidden to all."""


class HolderNameError(ValueError):
    """A common name that names no holder; the message is one sentence."""


_HOLDER = re.compile(r"[a-z0-9][a-z0-9_-]{0,57}")


@dataclass(frozen=True)
class Holder:
    """The holder of a certificate.

    Parameters
    ----------
    role : str
        A `Role`, or what else holds certificates: the router itself, and who reads its figures on its own machine.
    name : str
        Lower case letters, digits, '-' and '_', at most 58 characters.
    """

    role: str
    name: str

    def __post_init__(self) -> None:
        if self.role not in HOLDER_ROLES:
            raise HolderNameError(f"The role {self.role!r} is none of {', '.join(HOLDER_ROLES)}.")
        if _HOLDER.fullmatch(self.name) is None:
            raise HolderNameError(
                f"The holder's name {self.name!r} is not one of lower case letters, digits, '-' and '_', "
                "starting with a letter or digit, at most 58 characters."
            )

    @property
    def common_name(self) -> str:
        """`<role>.<name>`."""
        return f"{self.role}.{self.name}"

    @classmethod
    def parse(cls, common_name: str) -> Holder:
        """Return the holder with a common name.

        Raises
        ------
        HolderNameError
            It is not `<role>.<name>`.
        """
        role, dot, name = common_name.partition(".")
        if not dot:
            raise HolderNameError(f"The common name {common_name!r} is not of the form '<role>.<name>'.")
        return cls(role, name)


ROUTER: Final = "router"
"""Role of the router's own certificate; no client may use it."""

ADMIN: Final = "admin"
"""Role that reads the router's figures, from the router's own machine only."""

HOLDER_ROLES: Final = (*(role.value for role in Role), ROUTER, ADMIN)


def permits(role: Role, operation: Operation, key: str, keys: Keys) -> bool:
    """Return whether a role may do an operation on a key.

    Parameters
    ----------
    role : Role
        Whose.
    operation : Operation
        What.
    key : str
        A key without wildcards; one outside the contract is forbidden to all.
    keys : Keys
        Of the lab.
    """
    return any(row.permits(role, operation) for row in _rows(operation, key, keys))


def effect_of(key: str, keys: Keys) -> Effect:
    """Return what a query does to the lab; a query outside the contract is taken for a change.

    Parameters
    ----------
    key : str
        A key without wildcards.
    keys : Keys
        Of the lab.
    """
    rows = _rows(Operation.ASK, key, keys)
    return Effect.READ if rows and all(row.effect is Effect.READ for row in rows) else Effect.CHANGE


def _rows(operation: Operation, key: str, keys: Keys) -> list[KeyAccess]:
    """Return the most specific rows for an operation on a key."""
    rows = [row for row in ACCESS if operation in _OPERATIONS[row.kind] and covers(row.expression(keys), key)]
    # `campaign/start` is not `campaign/<id>`, though the expression of the latter matches it as well.
    return [row for row in rows if not any(_outranks(other, row, operation, keys) for other in rows)]


def reserved(role: Role, operation: Operation, keys: Keys) -> list[str]:
    """Return the expressions that a role may not use, though another one that it may use matches them.

    Parameters
    ----------
    role : Role
        Whose.
    operation : Operation
        What.
    keys : Keys
        Of the lab.
    """
    mine = [row for row in ACCESS if row.permits(role, operation)]
    others = [row for row in ACCESS if operation in _OPERATIONS[row.kind] and not row.permits(role, operation)]
    found = (other for other in others if any(_outranks(other, row, operation, keys) for row in mine))
    return list(dict.fromkeys(row.expression(keys) for row in found))


def _outranks(other: KeyAccess, row: KeyAccess, operation: Operation, keys: Keys) -> bool:
    """Return whether another row is about fewer keys of this one, for what is served and asked."""
    if operation not in _OPERATIONS[KeyKind.QUERY] or other.kind is not row.kind:
        return False
    narrow, wide = other.expression(keys), row.expression(keys)
    return narrow != wide and covers(wide, narrow)


def covers(expression: str, key: str) -> bool:
    """Return whether an expression of the table, with "*" for names, matches a key or a narrower expression."""
    parts, chunks = expression.split("/"), key.split("/")
    return len(parts) == len(chunks) and all(
        part == chunk or (part == ANY and not chunk.startswith("@")) for part, chunk in zip(parts, chunks, strict=True)
    )
