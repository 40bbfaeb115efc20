"""Every member, every key of the contract, every operation: tried over the router, and what came through.

Each member has a session that tries; the `main` of each role has a second one, its partner: the rightful other side of
what the others try. A trial has succeeded where the other side saw it.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from duralab_proto.access import ACCESS, KeyAccess, KeyKind, Operation, Slot, permits
from duralab_proto.keys import Keys
from duralab_proto.members import Member, Role

from .members import PROJECT, TRIED

_POLL_SECONDS = 0.05
_LONGEST_SECONDS = 20.0
# What has not come when everything that is allowed has come, and this long after, does not come.
_GRACE_SECONDS = 0.5
# Both may see every token of the table; and the name of one that is there throughout.
_WATCHERS = (Role.RIG, Role.RECORDER)
_MARKER = "marker"
_NAMED = {member.common_name: member for member in TRIED}


@dataclass(frozen=True)
class Trial:
    """One cell of the table: a member does an operation on a key."""

    member: Member
    operation: Operation
    key: str


# The names that bound members are bound to, and those of others.
_OWN = {Slot.RIG: "a", Slot.CAMPAIGN: f"{PROJECT}-1", Slot.RUN: f"{PROJECT}-1.i01", Slot.PROJECT: PROJECT}
_OTHER = {Slot.RIG: "b", Slot.CAMPAIGN: "other-1", Slot.RUN: "other-1.i01", Slot.PROJECT: "other"}


def trial_keys(keys: Keys) -> list[tuple[KeyAccess, str]]:
    """Return every row of the table with a key of those that some members are bound to, and one of the others."""
    both = [(row, _named(row, keys, names)) for row in ACCESS for names in (_OWN, _OTHER)]
    return list(dict.fromkeys(both))


def _named(row: KeyAccess, keys: Keys, names: dict[Slot, str]) -> str:
    given = [names.get(name, "a") if isinstance(name, Slot) else name for name in row.names]
    return f"{getattr(keys, row.method)(*given)}{row.suffix}"


def all_trials(keys: Keys) -> list[Trial]:
    """Return every cell, each once."""
    cells = [
        Trial(member, operation, key)
        for row, key in trial_keys(keys)
        for operation in (row.kind.owner_operation, row.kind.user_operation)
        for member in TRIED
        # Where nobody may hold a token there is none to be seen.
        if operation is not Operation.WATCH or any(permits(each, Operation.HOLD, key, keys) for each in TRIED)
    ]
    return list(dict.fromkeys(cells))


@contextmanager
def secured_session(endpoint: str, certificates: Path, name: str) -> Iterator[zenoh.Session]:
    """Open a plain Zenoh session, without the checks of duralab_bus, with a certificate of a folder."""
    with zenoh.open(secured_config(endpoint, certificates, name)) as session:
        yield session


def secured_config(endpoint: str, certificates: Path, name: str | None, **more: Any) -> zenoh.Config:
    """Return the configuration of a client of a secured router; without a certificate where there is no name."""
    config = zenoh.Config()
    tls: dict[str, Any] = {"root_ca_certificate": str(certificates / "ca.crt"), "verify_name_on_connect": True}
    if name is not None:
        tls |= {
            "connect_certificate": str(certificates / f"{name}.crt"),
            "connect_private_key": str(certificates / f"{name}.key"),
            "enable_mtls": True,
        }
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 10_000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/link/tls": tls,
        **more,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class _Seen:
    """Trials whose effect was seen by the other side."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._trials: set[Trial] = set()

    def add(self, trial: Trial) -> None:
        with self._changed:
            self._trials.add(trial)
            self._changed.notify_all()

    def after(self, expected: set[Trial]) -> set[Trial]:
        """Return what was seen when all that is expected was seen and a moment has passed."""
        with self._changed:
            self._changed.wait_for(lambda: expected <= self._trials, _LONGEST_SECONDS)
        time.sleep(_GRACE_SECONDS)
        with self._changed:
            return set(self._trials)


def run_trials(endpoint: str, certificates: Path, *, expected: set[Trial]) -> set[Trial]:
    """Try every cell and return those that came through.

    Parameters
    ----------
    endpoint : str
        Of the router.
    certificates : Path
        With a certificate for each member.
    expected : set of Trial
        What is waited for; the result does not depend on it otherwise.
    """
    keys = Keys()
    with ExitStack() as stack:

        def opened(name: str) -> zenoh.Session:
            return stack.enter_context(secured_session(endpoint, certificates, name))

        trying = {member: opened(member.common_name) for member in TRIED}
        partners = {role: opened(f"{role}.main") for role in Role}
        came = _try_streams(trying, partners, keys, expected)
        came |= _try_queries(trying, partners, keys, expected)
        return came | _try_liveliness(trying, partners, keys, expected)


Sessions = dict[Member, zenoh.Session]
Partners = dict[Role, zenoh.Session]


def _try_streams(trying: Sessions, partners: Partners, keys: Keys, expected: set[Trial]) -> set[Trial]:
    seen = _Seen()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.STREAM]
    declared: list[Any] = []
    for row, key in rows:
        for member in TRIED:
            received = Trial(member, Operation.RECEIVE, key)
            declared.append(trying[member].declare_subscriber(key, _on_partner(received, seen)))
        for user in row.users:
            declared.append(partners[user].declare_subscriber(key, _on_publication(key, seen)))
    # Zenoh knows of a subscriber a moment after it was declared.
    time.sleep(_GRACE_SECONDS)
    for row, key in rows:
        for member in TRIED:
            trying[member].put(key, member.common_name)
            # A deletion is a publication too; nobody may.
            trying[member].delete(key)
        for owner in row.owners:
            partners[owner].put(key, "partner")
    streams = {trial for trial in expected if trial.operation in (Operation.PUBLISH, Operation.RECEIVE)}
    came = seen.after(streams)
    for each in declared:
        each.undeclare()
    return came


def _on_partner(trial: Trial, seen: _Seen) -> Any:
    def take(sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == b"partner":
            seen.add(trial)

    return take


def _on_publication(key: str, seen: _Seen) -> Any:
    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            raise AssertionError(f"A deletion on {key} came through.")
        text = sample.payload.to_string()
        if text != "partner":
            seen.add(Trial(_NAMED[text], Operation.PUBLISH, key))

    return take


def _try_queries(trying: Sessions, partners: Partners, keys: Keys, expected: set[Trial]) -> set[Trial]:
    seen = _Seen()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.QUERY]
    declared: list[Any] = []
    for row, key in rows:
        for member in TRIED:
            served = Trial(member, Operation.SERVE, key)
            declared.append(trying[member].declare_queryable(key, _answering(seen, served=served)))
        for owner in row.owners:
            declared.append(partners[owner].declare_queryable(key, _answering(seen, key=key)))
    time.sleep(_GRACE_SECONDS)
    pending: list[Any] = []
    for row, key in rows:
        for member in TRIED:
            pending.append(
                trying[member].get(key, payload=member.common_name, target=zenoh.QueryTarget.ALL, timeout=2.0)
            )
        for user in row.users:
            pending.append(partners[user].get(key, payload="partner", target=zenoh.QueryTarget.ALL, timeout=2.0))
    queries = {trial for trial in expected if trial.operation in (Operation.ASK, Operation.SERVE)}
    came = seen.after(queries)
    for each in declared:
        each.undeclare()
    return came


def _answering(seen: _Seen, *, served: Trial | None = None, key: str = "") -> Any:
    """Return what answers a query and notes who asked, or that the query reached who tries to serve."""

    def take(query: zenoh.Query) -> None:
        with query:
            asker = query.payload.to_string() if query.payload is not None else ""
            if served is not None:
                # Asked by the rightful users' sessions; those of the other trials ask it as well.
                if asker == "partner":
                    seen.add(served)
            elif asker != "partner":
                seen.add(Trial(_NAMED[asker], Operation.ASK, key))
            query.reply(query.key_expr, b"")

    return take


def _try_liveliness(trying: Sessions, partners: Partners, keys: Keys, expected: set[Trial]) -> set[Trial]:
    came: set[Trial] = set()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.LIVELINESS]
    held = sorted({key for _, key in rows})
    marker = partners[Role.ITERATOR].liveliness().declare_token(keys.asking(_MARKER))
    for member in TRIED:
        # One member after the other: a token does not say whose it is. One that comes back at once under the same name
        # was never gone for who watches: each has a name of its own where none is bound to the name.
        seen = _Seen()
        own = {key: token_key(key, member) for key in held}
        watches = [
            partners[watcher]
            .liveliness()
            .declare_subscriber(own[key], _noting(Trial(member, Operation.HOLD, key), seen))
            for key in held
            for watcher in _WATCHERS
        ]
        for watcher in _WATCHERS:
            _wait_until_watching(partners[watcher], keys.asking(_MARKER))
        tokens = [trying[member].liveliness().declare_token(own[key]) for key in held]
        mine = {trial for trial in expected if trial.member == member and trial.operation is Operation.HOLD}
        came |= seen.after(mine)
        for each in tokens:
            each.undeclare()
        _wait_until_gone(partners[_WATCHERS[0]], own.values())
        for each in watches:
            each.undeclare()
    marker.undeclare()
    seen = _Seen()
    tokens = [partners[owner].liveliness().declare_token(key) for row, key in rows for owner in row.owners[:1]]
    watches = [
        trying[member]
        .liveliness()
        .declare_subscriber(key, _noting(Trial(member, Operation.WATCH, key), seen), history=True)
        for key in held
        for member in TRIED
    ]
    came |= seen.after({trial for trial in expected if trial.operation is Operation.WATCH})
    for each in [*watches, *tokens]:
        each.undeclare()
    return came


def _wait_until_watching(session: zenoh.Session, marker: str) -> None:
    """Wait until the router knows of all that a session watches: it hears of it in order, and of this one last."""
    told = threading.Event()
    watch = session.liveliness().declare_subscriber(marker, lambda _: told.set(), history=True)
    assert told.wait(_LONGEST_SECONDS)
    watch.undeclare()


def _wait_until_gone(session: zenoh.Session, held: Iterable[str]) -> None:
    deadline = time.monotonic() + _LONGEST_SECONDS
    while any(reply.ok is not None for key in held for reply in session.liveliness().get(key, timeout=2.0)):
        assert time.monotonic() < deadline
        time.sleep(_POLL_SECONDS)


def token_key(key: str, member: Member) -> str:
    """Return the key of the token by which a member tries to hold a key."""
    free = key.endswith("/a") and "/live/rig_sim/" not in key
    return f"{key.removesuffix('/a')}/{member.common_name}" if free else key


def _noting(trial: Trial, seen: _Seen) -> Any:
    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            seen.add(trial)

    return take
