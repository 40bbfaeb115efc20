"""Conditions of a motion besides the role: a second deliberate act, recent data, and holding the rig."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

ARMED_SECONDS = 10.0
"""Longest time between the first and the second act."""
OLDEST_SECONDS = 3.0
"""Largest age of the data on which a person acts; older data may no longer be valid."""
MOST_ARMED = 1000


class Arming:
    """First of two acts: it names an action with all of its values and returns a token that allows it once."""

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._armed: dict[str, tuple[str, str, float]] = {}

    def arm(self, who: str, action: str, values: Mapping[str, Any]) -> str:
        """Return the token that allows an action once, for the person who armed it, with these values."""
        word = secrets.token_urlsafe(16)
        with self._lock:
            now = self._clock()
            self._armed = {key: one for key, one in self._armed.items() if one[2] > now}
            if len(self._armed) >= MOST_ARMED:
                self._armed.pop(next(iter(self._armed)))
            self._armed[word] = (who, _key(action, values), now + ARMED_SECONDS)
        return word

    def use(self, word: str, who: str, action: str, values: Mapping[str, Any]) -> bool:
        """Return whether an action was armed by the same person and session, and is neither used nor too old."""
        with self._lock:
            found = self._armed.pop(word, None)
            return found is not None and found[:2] == (who, _key(action, values)) and found[2] > self._clock()


def _key(action: str, values: Mapping[str, Any]) -> str:
    return json.dumps([action, values], sort_keys=True)


@dataclass(frozen=True)
class Holder:
    """Holder of a rig, and the start of the hold in seconds since 1970 UTC."""

    name: str
    since: float


class Holders:
    """Holders of the rigs: the first person who commands a rig, until another one takes it over."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders: dict[str, Holder] = {}

    def of(self, rig: str) -> Holder | None:
        """Return the holder of a rig."""
        return self._holders.get(rig)

    def require(self, name: str, *rigs: str) -> list[str]:
        """Make `name` the holder of all rigs or of none, and return those that had no holder.

        Raises PermissionError with a sentence if another person holds one of them.
        """
        with self._lock:
            for rig in rigs:
                if (holder := self._holders.get(rig)) is not None and holder.name != name:
                    raise PermissionError(
                        f"{holder.name} holds the rig {rig}; ask {holder.name}, or take the rig over first."
                    )
            new = [rig for rig in rigs if rig not in self._holders]
            self._holders.update({rig: Holder(name, time.time()) for rig in new})
        return new

    def take(self, rig: str, name: str) -> Holder | None:
        """Give a rig to a person; return its earlier holder."""
        with self._lock:
            before = self._holders.get(rig)
            self._holders[rig] = Holder(name, time.time())
        return before

    def release(self, rig: str, name: str) -> bool:
        """Release a rig held by this person; return whether it was."""
        with self._lock:
            held = (found := self._holders.get(rig)) is not None and found.name == name
            if held:
                del self._holders[rig]
        return held
