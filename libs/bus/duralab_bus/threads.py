"""Threads that call Zenoh: daemons while the process works, and ended before its interpreter ends.

Python up to 3.13 ends a daemon thread that comes back from native code into an ending interpreter by `pthread_exit`.
Zenoh's Rust code does not let that pass, and the process aborts after its work is done: "FATAL: exception not
rethrown". Threads that are not daemons would keep a process with a stuck callback alive for ever.
"""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

_ENDING_SECONDS: Final = 5.0


class _Closable(Protocol):
    def close(self) -> None: ...


class BusThread(threading.Thread):
    """Daemon thread that the end of the interpreter waits for, up to `_ENDING_SECONDS`."""

    def __init__(self, target: Callable[..., object], *args: Any, name: str) -> None:
        super().__init__(target=target, args=args, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        super().start()
        with _lock:
            _threads[:] = [each for each in _threads if each.is_alive()]
            _threads.append(self)


_lock = threading.Lock()
_threads: list[BusThread] = []
_open: list[_Closable] = []


def close_at_exit(opened: _Closable) -> None:
    """Close this when the interpreter ends, unless `closed` is called first."""
    with _lock:
        _open.append(opened)


def closed(opened: _Closable) -> None:
    """Note that this is closed."""
    with _lock:
        _open.remove(opened)


@atexit.register
def _end() -> None:
    for opened in list(_open):
        opened.close()
    until = time.monotonic() + _ENDING_SECONDS
    for thread in list(_threads):
        thread.join(max(0.0, until - time.monotonic()))
