"""Every role, every key of the contract, every operation: tried over the router, and what came through.

Each role has a session that tries; a second one with a certificate of the same role is its partner, the rightful other
side of what the others try. A trial has succeeded where the other side saw it.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from duralab_proto.access import ACCESS, KeyAccess, KeyKind, Operation, Role, permits
from duralab_proto.keys import Keys

_POLL_SECONDS = 0.05
_LONGEST_SECONDS = 20.0
# What has not come when everything that is allowed has come, and this long after, does not come.
_GRACE_SECONDS = 0.5
# Both may see every token of the table; and the name of one that is there throughout.
_WATCHERS = (Role.RIG, Role.RECORDER)
_MARKER = "marker"


@dataclass(frozen=True)
class Trial:
    """One cell of the table: a role does an operation on a key."""

    role: Role
    operation: Operation
    key: str


def trial_keys(keys: Keys) -> list[tuple[KeyAccess, str]]:
    """Return every row of the table with a key of it: "a" for each name."""
    return [(row, row.expression(keys).replace("*", "a")) for row in ACCESS]


def all_trials(keys: Keys) -> list[Trial]:
    """Return every cell, each once."""
    cells = [
        Trial(role, operation, key)
        for row, key in trial_keys(keys)
        for operation in (row.kind.owner_operation, row.kind.user_operation)
        for role in Role
        # Where nobody may hold a token there is none to be seen.
        if operation is not Operation.WATCH or any(permits(each, Operation.HOLD, key, keys) for each in Role)
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
        With a certificate `<role>.main` for each role.
    expected : set of Trial
        What is waited for; the result does not depend on it otherwise.
    """
    keys = Keys()
    with ExitStack() as stack:

        def opened() -> dict[Role, zenoh.Session]:
            return {role: stack.enter_context(secured_session(endpoint, certificates, f"{role}.main")) for role in Role}

        trying, partners = opened(), opened()
        came = _try_streams(trying, partners, keys, expected)
        came |= _try_queries(trying, partners, keys, expected)
        return came | _try_liveliness(trying, partners, keys, expected)


Sessions = dict[Role, zenoh.Session]


def _try_streams(trying: Sessions, partners: Sessions, keys: Keys, expected: set[Trial]) -> set[Trial]:
    seen = _Seen()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.STREAM]
    declared: list[Any] = []
    for row, key in rows:
        for role in Role:
            received = Trial(role, Operation.RECEIVE, key)
            declared.append(trying[role].declare_subscriber(key, _on_partner(received, seen)))
        for user in row.users:
            declared.append(partners[user].declare_subscriber(key, _on_publication(key, seen)))
    # Zenoh knows of a subscriber a moment after it was declared.
    time.sleep(_GRACE_SECONDS)
    for row, key in rows:
        for role in Role:
            trying[role].put(key, role.value)
            # A deletion is a publication too; nobody may.
            trying[role].delete(key)
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
            seen.add(Trial(Role(text), Operation.PUBLISH, key))

    return take


def _try_queries(trying: Sessions, partners: Sessions, keys: Keys, expected: set[Trial]) -> set[Trial]:
    seen = _Seen()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.QUERY]
    declared: list[Any] = []
    for row, key in rows:
        for role in Role:
            served = Trial(role, Operation.SERVE, key)
            declared.append(trying[role].declare_queryable(key, _answering(seen, served=served)))
        for owner in row.owners:
            declared.append(partners[owner].declare_queryable(key, _answering(seen, key=key)))
    time.sleep(_GRACE_SECONDS)
    pending: list[Any] = []
    for row, key in rows:
        for role in Role:
            pending.append(trying[role].get(key, payload=role.value, target=zenoh.QueryTarget.ALL, timeout=2.0))
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
                seen.add(Trial(Role(asker), Operation.ASK, key))
            query.reply(query.key_expr, b"")

    return take


def _try_liveliness(trying: Sessions, partners: Sessions, keys: Keys, expected: set[Trial]) -> set[Trial]:
    came: set[Trial] = set()
    rows = [(row, key) for row, key in trial_keys(keys) if row.kind is KeyKind.LIVELINESS]
    held = sorted({key for _, key in rows})
    marker = partners[Role.ITERATOR].liveliness().declare_token(keys.asking(_MARKER))
    for role in Role:
        # One role after the other: a token does not say whose it is. One that comes back at once under the same name
        # was never gone for who watches: each has a name of its own, where the key has one.
        seen = _Seen()
        own = {key: token_key(key, role) for key in held}
        watches = [
            partners[watcher].liveliness().declare_subscriber(own[key], _noting(Trial(role, Operation.HOLD, key), seen))
            for key in held
            for watcher in _WATCHERS
        ]
        for watcher in _WATCHERS:
            _wait_until_watching(partners[watcher], keys.asking(_MARKER))
        tokens = [trying[role].liveliness().declare_token(own[key]) for key in held]
        mine = {trial for trial in expected if trial.role is role and trial.operation is Operation.HOLD}
        came |= seen.after(mine)
        for each in [*watches, *tokens]:
            each.undeclare()
    marker.undeclare()
    seen = _Seen()
    tokens = [partners[owner].liveliness().declare_token(key) for row, key in rows for owner in row.owners[:1]]
    watches = [
        trying[role]
        .liveliness()
        .declare_subscriber(key, _noting(Trial(role, Operation.WATCH, key), seen), history=True)
        for key in held
        for role in Role
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


def token_key(key: str, role: Role) -> str:
    """Return the key of the token by which a role tries to hold a key."""
    return f"{key.removesuffix('/a')}/{role}" if key.endswith("/a") else key


def _noting(trial: Trial, seen: _Seen) -> Any:
    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            seen.add(trial)

    return take
