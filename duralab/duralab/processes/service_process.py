"""Process of a service on this machine; on Linux it is forked from a process that has made the imports.

On Linux a separate process makes the services' common imports once and forks each service, see `fork_server`. Other
systems start a new Python for each service.
"""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
import weakref
from contextlib import suppress
from pathlib import Path
from threading import Lock
from types import MappingProxyType
from typing import IO, Final, Protocol

import psutil

from duralab.errors import LabError

# A campaign's matrices are small: with several BLAS threads, waiting took five times the processor time, and sums in
# another order differ in their last bits. The user's environment can override it.
_ONE_THREAD: Final = MappingProxyType({"OMP_NUM_THREADS": "1"})
_LARGEST_PACKET: Final = 65_536
UNKNOWN_EXIT: Final = 256
"""Code for an unknown exit code; no process can have it."""

_LOST_SECONDS: Final = 0.05
_START_SECONDS: Final = 60.0
"""Longest time until a service is forked, including imports."""


class ServiceProcess(Protocol):
    """Interface of a service's process, a part of that of `subprocess.Popen`."""

    @property
    def pid(self) -> int:
        """Process id."""
        ...

    @property
    def stdin(self) -> IO[bytes] | None:
        """Other end of the service's standard input: the service ends when this is closed."""
        ...

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, or None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end and return the exit code; raises subprocess.TimeoutExpired after `timeout` seconds."""
        ...

    def terminate(self) -> None:
        """Ask it to end."""
        ...

    def kill(self) -> None:
        """End it by force."""
        ...


def start_service(name: str, *, config: Path, log: Path) -> ServiceProcess:
    """Start a service with its configuration and its existing log; raises OSError if no process can be started."""
    if sys.platform == "linux":
        return _server().start(name, config=config, log=log)
    with log.open("ab") as stream:
        return subprocess.Popen(
            [sys.executable, "-m", name, "--config", str(config)],
            stdin=subprocess.PIPE,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env=_environment(),
            # A Ctrl-C in the terminal is for this process alone: it stops the campaign before it ends the services.
            start_new_session=True,
        )


def import_ahead() -> None:
    """Start the services' common imports in the background, while this process reads its arguments."""
    if sys.platform == "linux":
        with suppress(OSError):  # reported at the start of a service
            _server()


def _environment() -> dict[str, str]:
    return {**_ONE_THREAD, **os.environ}


if sys.platform == "linux":

    class _ForkServer:
        """Client of the process that forks services, for one environment."""

        def __init__(self, environment: dict[str, str]) -> None:
            self.environment = environment
            self._lock = Lock()
            self._ended: dict[int, int] = {}
            own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            said = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
            try:
                process = subprocess.Popen(
                    [sys.executable, "-m", "duralab.processes.fork_server", str(other.fileno())],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=said,
                    env=environment,
                    pass_fds=[other.fileno()],
                    # A Ctrl-C in the terminal is for this process alone: it stops the campaign before it ends the
                    # services.
                    start_new_session=True,
                )
            except OSError:
                own.close()
                said.close()
                raise
            finally:
                other.close()
            self._socket, self._process, self._said = own, process, said
            # Close it with the last of its services' objects, or with this process.
            weakref.finalize(self, _close_server, own, process, said)

        @property
        def running(self) -> bool:
            """Whether the process can start services."""
            return self._process.poll() is None

        def start(self, name: str, *, config: Path, log: Path) -> _ForkedService:
            """Fork a service; raises OSError if that fails."""
            request = {"name": name, "config": str(config), "log": str(log.resolve()), "folder": str(Path.cwd())}
            reading, writing = os.pipe()
            with self._lock:
                try:
                    socket.send_fds(self._socket, [json.dumps(request).encode()], [reading])
                    answer = self._answer()
                except OSError as error:
                    os.close(writing)
                    raise self._lost() from error
                except LabError:
                    os.close(writing)
                    raise
                finally:
                    os.close(reading)
            if "error" in answer:
                os.close(writing)
                raise OSError(answer["error"], os.strerror(answer["error"]))
            return _ForkedService(self, answer["pid"], os.fdopen(writing, "wb"))

        def code_of(self, pid: int, timeout_seconds: float = 0.0) -> int | None:
            """Return the exit code of a service, or None if it has not ended in this time."""
            deadline = time.monotonic() + timeout_seconds
            while True:
                with self._lock:
                    try:
                        while pid not in self._ended and self._readable(0.0):
                            self._take(self._receive())
                    except LabError:
                        # Services can outlive the process that forked them; then their exit codes are unknown.
                        if not _exists(pid):
                            self._ended[pid] = UNKNOWN_EXIT
                        time.sleep(min(_LOST_SECONDS, max(0.0, deadline - time.monotonic())))
                    if pid in self._ended:
                        return self._ended[pid]
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return None
                self._readable(left)

        def _answer(self) -> dict[str, int]:
            """Return the answer to a request; store exit codes that arrive before it."""
            while self._readable(_START_SECONDS):
                message = self._receive()
                if "ended" not in message:
                    return message
                self._take(message)
            raise LabError(f"No service was forked in {_START_SECONDS:g} s; free processor time and start again.")

        def _take(self, message: dict[str, int]) -> None:
            self._ended[message["ended"]] = message["code"]

        def _receive(self) -> dict[str, int]:
            with suppress(ConnectionError):
                if packet := self._socket.recv(_LARGEST_PACKET):
                    return json.loads(packet)
            raise self._lost()

        def _readable(self, seconds: float) -> bool:
            poll = select.poll()  # not select, which does not support file numbers above 1023
            poll.register(self._socket, select.POLLIN)
            return bool(poll.poll(1000.0 * seconds))

        def _lost(self) -> LabError:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            self._said.seek(0)
            lines = self._said.read().decode("utf-8", errors="replace").strip().splitlines()
            said = f": {lines[-1].rstrip('.')}" if lines else ""
            return LabError(f"The process that starts the services ended by itself{said}; start the lab again.")

    class _ForkedService:
        """Forked service."""

        def __init__(self, server: _ForkServer, pid: int, stdin: IO[bytes]) -> None:
            self._server = server
            self.pid = pid
            self.stdin: IO[bytes] | None = stdin

        def poll(self) -> int | None:
            """Return the exit code, or None while it runs."""
            return self._server.code_of(self.pid)

        def wait(self, timeout: float | None = None) -> int:
            """Wait for the end and return the exit code."""
            while (code := self._server.code_of(self.pid, 3600.0 if timeout is None else timeout)) is None:
                if timeout is not None:
                    raise subprocess.TimeoutExpired(str(self.pid), timeout)
            return code

        def terminate(self) -> None:
            """Ask it to end."""
            self._signal(15)

        def kill(self) -> None:
            """End it by force."""
            self._signal(9)

        def _signal(self, number: int) -> None:
            # The server has waited for ended services, so the id may now be that of another process.
            if self.poll() is None:
                with suppress(ProcessLookupError):
                    os.kill(self.pid, number)

    def _exists(pid: int) -> bool:
        try:
            return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    _servers: list[_ForkServer] = []
    _servers_lock = Lock()

    def _server() -> _ForkServer:
        """Return the server for the present environment; start a new one if the environment changed or it ended."""
        environment = _environment()
        with _servers_lock:
            if not (_servers and _servers[0].environment == environment and _servers[0].running):
                _servers[:] = [_ForkServer(environment)]
            return _servers[0]

    def _close_server(own: socket.socket, process: subprocess.Popen[bytes], said: IO[bytes]) -> None:
        own.close()
        said.close()
        # It may still be importing; services end by the end of their standard input.
        process.terminate()
        process.wait()
