"""Sessions of the page: expiry, tokens against forged requests, rate limits."""

from __future__ import annotations

import hashlib
import hmac
import math
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

from operator_page.accounts import PageRole

MOST_SESSIONS = 1000
"""Largest number of sessions; beyond it the one that was idle longest ends."""


@dataclass
class Session:
    """One signed-in browser."""

    name: str
    role: PageRole
    ends: float
    # A page of another origin cannot read the token, so it cannot send it.
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    used: float = 0.0
    # Common name of the certificate that it began with: its cookie is valid only with that certificate.
    certificate: str = ""

    def is_own(self, token: str) -> bool:
        """Return whether a request carries this session's token."""
        return hmac.compare_digest(token.encode(), self.token.encode())


class Sessions:
    """Sessions by the hash of their cookie; safe for threads."""

    def __init__(self, seconds: float, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._seconds, self._clock = seconds, clock
        self._lock = threading.Lock()
        self._known: dict[str, Session] = {}

    def begin(
        self, name: str, role: PageRole, *, certificate: str = "", seconds: float = math.inf
    ) -> tuple[str, Session]:
        """Return the cookie of a new session, and the session; `seconds`: Longest duration of the session."""
        cookie = secrets.token_urlsafe(32)
        with self._lock:
            now = self._clock()
            self._known = {key: one for key, one in self._known.items() if one.ends > now}
            if len(self._known) >= MOST_SESSIONS:
                del self._known[min(self._known, key=lambda key: self._known[key].used)]
            session = self._known[_hash(cookie)] = Session(
                name, role, now + min(self._seconds, seconds), used=now, certificate=certificate
            )
        return cookie, session

    def find(self, cookie: str) -> Session | None:
        """Return the session of a cookie; None if there is none, or it has ended."""
        with self._lock:
            session, now = self._known.get(_hash(cookie)), self._clock()
            if session is None or session.ends <= now:
                return None
            session.used = now
            return session

    def end(self, cookie: str) -> None:
        """Sign out."""
        with self._lock:
            self._known.pop(_hash(cookie), None)

    def __len__(self) -> int:
        """Return the number of sessions."""
        return len(self._known)


def _hash(cookie: str) -> str:
    # The memory of this process contains no cookies.
    return hashlib.sha256(cookie.encode("utf-8", "replace")).hexdigest()


class RateLimit:
    """Rate limit for each key: `at_once` calls in a burst, then `per_second`; safe for threads."""

    def __init__(
        self, at_once: float, per_second: float, *, most_keys: int = 10_000, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._at_once, self._per_second, self._most_keys, self._clock = at_once, per_second, most_keys, clock
        self._lock = threading.Lock()
        self._left: OrderedDict[Hashable, tuple[float, float]] = OrderedDict()

    def allows(self, key: Hashable, *, cost: float = 1.0) -> bool:
        """Use one call of a key; return False if none is left now. A cost of 0 only checks."""
        with self._lock:
            now = self._clock()
            left, then = self._left.pop(key, (self._at_once, now))
            left = min(self._at_once, left + (now - then) * self._per_second)
            allowed = left >= max(cost, 1.0)
            self._left[key] = (left - cost if allowed else left, now)
            if len(self._left) > self._most_keys:
                self._left.popitem(last=False)
            return allowed
