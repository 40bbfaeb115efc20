"""Runs a module or a script as on Windows: `windows_process.py MODULE_OR_SCRIPT [ARGUMENT …]`.

What Windows lacks is hidden from the code of this repository, and from it alone: modules such as fcntl, names of `os`,
`signal` and `time`, and Drake, which has no wheel there. `sys.platform` says win32 to it; `msvcrt` stands in, over
flock. A file that this process has open cannot be removed or replaced, and no pipe takes the bytes of signals.
"""

from __future__ import annotations

import builtins
import fcntl
import os
import runpy
import signal
import stat
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

OURS = ("duralab", "identifier", "iterator", "recorder", "rig_sim", "file_rig", "__main__")
NO_MODULES = frozenset(
    {"fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty", "pydrake", "rig_sim"}
)
NO_NAMES = {
    "os": {
        *("fork", "forkpty", "register_at_fork", "setsid", "setpgid", "getpgid", "getpgrp", "killpg", "wait", "waitid"),
        *("getuid", "geteuid", "getgid", "getegid", "getgroups", "chown", "fchown", "lchown", "fchmod", "mkfifo"),
        *(
            "pread",
            "preadv",
            "pwrite",
            "pwritev",
            "posix_fallocate",
            "posix_fadvise",
            "sendfile",
            "statvfs",
            "fstatvfs",
        ),
        *("sched_getaffinity", "sched_setaffinity", "sched_yield", "set_blocking", "get_blocking", "pipe2", "uname"),
        *("O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_SYNC", "SEEK_DATA", "SEEK_HOLE", "sync", "nice"),
        *("memfd_create", "openpty", "ttyname", "confstr", "sysconf", "getloadavg", "fdatasync", "lockf", "WNOHANG"),
        *("kill",),  # It exists, and ends the process at once: nothing of ours may count on it.
    },
    "signal": {
        *("SIGHUP", "SIGUSR1", "SIGUSR2", "SIGKILL", "SIGALRM", "SIGCHLD", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGCONT"),
        *("alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "siginterrupt", "sigpending", "sigwait"),
    },
    "time": {"clock_gettime", "clock_gettime_ns", "clock_settime", "tzset", "CLOCK_MONOTONIC", "CLOCK_REALTIME"},
}


class _Seen(ModuleType):
    """A module as Windows has it."""

    def __init__(self, module: ModuleType, hidden: frozenset[str], given: Mapping[str, Any]) -> None:
        super().__init__(module.__name__)
        vars(self).update(_module=module, _hidden=hidden, _given=given)

    def __getattr__(self, name: str) -> Any:
        if name in self._hidden:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} on Windows")
        return self._given[name] if name in self._given else getattr(self._module, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._module, name, value)


def _msvcrt() -> ModuleType:
    module = ModuleType("msvcrt")

    def locking(descriptor: int, mode: int, _bytes: int) -> None:
        fcntl.flock(descriptor, mode)

    vars(module).update(LK_NBLCK=fcntl.LOCK_EX | fcntl.LOCK_NB, LK_UNLCK=fcntl.LOCK_UN, locking=locking)
    return module


def _set_wakeup_fd(descriptor: int, **more: Any) -> int:
    if descriptor != -1 and not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
        raise ValueError("only a socket takes the bytes of signals on Windows")
    return signal.set_wakeup_fd(descriptor, **more)


def _open_folder_refused(path: Any, flags: int, mode: int = 0o777) -> int:
    if isinstance(path, str | os.PathLike) and Path(path).is_dir():
        raise PermissionError(13, "a folder cannot be opened on Windows", str(path))
    return os.open(path, flags, mode)


def _keeping_open_files(change: Callable[..., None]) -> Callable[..., None]:
    """Refuse to remove, rename or replace a file that this process has open."""

    def changed(*paths: Any, **more: Any) -> None:
        named = {os.path.realpath(path) for path in paths if isinstance(path, str | os.PathLike)}
        for link in Path("/proc/self/fd").iterdir():
            # The folder's own descriptor is gone again.
            with suppress(FileNotFoundError):
                if str(held := link.readlink()) in named:
                    raise PermissionError(13, "the file is open in a process", str(held))
        change(*paths, **more)

    return changed


def _is_ours(namespace: Mapping[str, Any] | None) -> bool:
    if namespace is None:
        return False
    spec = namespace.get("__spec__")
    name = spec.name if spec is not None else str(namespace.get("__name__", ""))
    top = name.partition(".")[0]
    return top in OURS or top.startswith("duralab_")


def hide_posix() -> None:
    """Hide from now on what Windows lacks."""
    given: dict[str, dict[str, Any]] = {
        "os": {"O_BINARY": 0, "O_NOINHERIT": 0, "open": _open_folder_refused},
        "signal": {"SIGBREAK": signal.SIGTTIN, "set_wakeup_fd": _set_wakeup_fd},
        "time": {},
        "sys": {"platform": "win32"},
    }
    real = {"os": os, "signal": signal, "time": time, "sys": sys}
    seen = {name: _Seen(module, frozenset(NO_NAMES.get(name, ())), given[name]) for name, module in real.items()} | {
        "msvcrt": _msvcrt()
    }
    imported = builtins.__import__

    def as_on_windows(
        name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0
    ) -> ModuleType:
        if level == 0 and _is_ours(globals):
            if name.partition(".")[0] in NO_MODULES:
                raise ModuleNotFoundError(f"No module named {name!r} on Windows", name=name)
            if name in seen:
                return seen[name]
        return imported(name, globals, locals, fromlist, level)

    builtins.__import__ = as_on_windows
    for change in ("unlink", "remove", "rename", "replace"):
        setattr(os, change, _keeping_open_files(getattr(os, change)))


if __name__ == "__main__":
    target, *arguments = sys.argv[1:]
    sys.argv = [target, *arguments]
    hide_posix()
    if target.endswith(".py"):
        runpy.run_path(target, run_name="__main__")
    else:
        runpy.run_module(target, run_name="__main__", alter_sys=True)
