"""Recordings whose disk refused a write: the safe part of their files, and the messages to write again."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from duralab_bus import StreamItem
from recorder.log.recording import DiskError

RETRY_SECONDS: Final = 1.0

CLAIM_SECONDS: Final = 30.0
"""Time that unclaimed messages are kept for a recording that cannot be read; longer would hold up the lab."""

_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


@dataclass
class Interruption:
    """Reason for the wait of a recording, the file to cut and its safe bytes, and the messages held for it."""

    why: str
    file: tuple[Path, int] | None
    unread: bool = False
    claims_until: float = -math.inf
    held: list[StreamItem[Any]] = field(default_factory=list)
    retry_at: float = field(default_factory=lambda: time.monotonic() + RETRY_SECONDS)

    def postpone(self) -> None:
        """Try again later."""
        self.retry_at = time.monotonic() + RETRY_SECONDS


class Interruptions(dict[str, Interruption]):
    """Recordings that wait for their disk, by name."""

    def __init__(self) -> None:
        super().__init__()
        self._unclaimed: list[StreamItem[Any]] = []

    def begin(self, name: str, *, why: str, file: tuple[Path, int] | None) -> None:
        """Record that a recording waits for its disk."""
        self[name] = Interruption(why, file)
        with contextlib.suppress(OSError):
            self.cut(name)

    def begin_unread(self, name: str, error: OSError | DiskError) -> None:
        """Record that an unfinished recording could not be reopened: its playbacks are not known.

        A full disk is a short fault, and all messages that may be of the recording are kept until it ends. A file that
        cannot be read, perhaps years old, must not hold up the lab.
        """
        said = error.__cause__ if isinstance(error, DiskError) else error
        no_room = not isinstance(said, OSError) or said.errno in _NO_ROOM
        why = error.why if isinstance(error, DiskError) else error.strerror or str(error)
        claims_until = math.inf if no_room else time.monotonic() + CLAIM_SECONDS
        self[name] = Interruption(why, None, unread=True, claims_until=claims_until)

    def cut(self, name: str) -> None:
        """Cut off data that is not certain to be on the disk; raises OSError if the disk refuses even that."""
        file = self[name].file
        if file is not None:
            path, safe = file
            os.truncate(path, min(safe, path.stat().st_size))
            # Only once: later data was written when the disk accepted it again.
            self[name].file = None

    def hold_unclaimed(self, item: StreamItem[Any]) -> bool:
        """Keep a message of an unknown playback while an unread recording may claim it; return whether it is kept."""
        claiming = self._claiming
        if claiming:
            self._unclaimed.append(item)
        return claiming

    @property
    def _claiming(self) -> bool:
        now = time.monotonic()
        return any(now < waiting.claims_until for waiting in self.values())

    def take_given_up(self) -> list[StreamItem[Any]]:
        """Return the unclaimed messages once no unread recording may claim them any longer."""
        return [] if self._claiming else self.take_unclaimed()

    def due(self) -> list[str]:
        """Return the recordings that can be tried again now."""
        now = time.monotonic()
        return [name for name, waiting in self.items() if now >= waiting.retry_at]

    def take_unclaimed(self) -> list[StreamItem[Any]]:
        """Return the unclaimed messages, to be processed again."""
        unclaimed, self._unclaimed = self._unclaimed, []
        return unclaimed
