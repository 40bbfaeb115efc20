"""Process of a service: configuration, log, bus, liveliness, end within a time limit, and diagnosis."""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn, TypeVar

import structlog
from pydantic import BaseModel, ConfigDict, DirectoryPath, Field

from duralab_bus.bus import Bus, open_bus
from duralab_bus.faults import BusError, FaultError
from duralab_bus.metrics import MetricsConfig, serve_metrics
from duralab_bus.process.background_imports import import_in_background
from duralab_bus.process.logs import configure_logs
from duralab_bus.session import BusConfig
from duralab_bus.tracing import SpanKind, record_trace, span
from duralab_bus.yaml_config import ConfigError, configured
from duralab_proto.keys import MAIN_INSTANCE


def stacks() -> dict[str, list[str]]:
    """Return the call stack of every thread, the outermost call first.

    faulthandler is not used: it reads the frames of threads while they run. Of three dozen processes that were asked
    to end meanwhile, one crashed.
    """
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    return {
        # Without the source lines: no file is read while a rig plays.
        f"{names.get(number, 'native')} {number}": [
            f"{call.f_code.co_filename}:{line} {call.f_code.co_name}"
            for call, line in reversed(list(traceback.walk_stack(frame)))
        ]
        for number, frame in sys._current_frames().items()  # noqa: SLF001 - the only way, and documented
    }


def log_stacks() -> None:
    """Log the call stack of every thread."""
    structlog.get_logger("duralab_bus").warning("asked where the threads are", threads=stacks())


def log_stacks_on_signal() -> None:
    """Log the call stacks of all threads on SIGUSR1, in a process that is not a service; call on the main thread.

    Windows has no such signal: nothing happens there.
    """
    if sys.platform == "win32":
        return
    # On a separate thread: the main one may be in the middle of a line of the log.
    signal.signal(signal.SIGUSR1, lambda _number, _frame: threading.Thread(target=log_stacks, daemon=True).start())


EXIT_MISCONFIGURED: Final = 2
EXIT_STUCK: Final = 1
_EXIT_SECONDS: Final = 2.8


class ServiceConfig(BaseModel):
    """Settings that all services share; services add their own fields in a subclass."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    bus: BusConfig = BusConfig()
    # End when standard input ends: the supervisor holds the other end of the pipe, so that no service outlives it.
    exit_with_parent: bool = False
    # Address for Prometheus; no metrics are served if omitted.
    metrics: MetricsConfig | None = None
    # Number of queries of one key that are answered at once.
    workers: int = Field(default=4, ge=1, le=64)
    # Existing folder for a trace of its work; no trace is written if omitted.
    trace_folder: DirectoryPath | None = None


ServiceConfigT = TypeVar("ServiceConfigT", bound=ServiceConfig)

Build = Callable[[Bus], AbstractContextManager[object] | None]


def run_service(
    name: str,
    config: ServiceConfig,
    build: Build,
    *,
    instances: Sequence[str] = (MAIN_INSTANCE,),
    needs_later: Sequence[str] = (),
) -> None:
    """Run a service until a stop is requested.

    `build` is called with the open bus and declares the served keys. It may return a context manager, entered at once
    and left before the bus closes. Instances are declared live after everything else: the rigs of rig_sim, "main" of
    the others. `needs_later` is imported after that. Ends the process with code 2 after one sentence on standard error
    when the bus or the service cannot be set up as configured. Returns within 3 s after SIGTERM, SIGINT or, with
    `exit_with_parent`, the end of standard input. Logs its threads' call stacks on SIGUSR1, if the system has it.
    """
    configure_logs(name)
    log = structlog.get_logger(name)
    stop = _StopSignal(log)
    stop.listen(standard_input=config.exit_with_parent)
    with ExitStack() as stack:
        try:
            if config.trace_folder is not None:
                stack.enter_context(record_trace(config.trace_folder, name))
            with span(f"set up {name}", SpanKind.START):
                bus = stack.enter_context(open_bus(config.bus, service=name, workers=config.workers))
                context = build(bus)
                if context is not None:
                    stack.enter_context(context)
            metrics = stack.enter_context(serve_metrics(config.metrics, bus.metrics)) if config.metrics else None
        except (BusError, ConfigError, FaultError) as error:
            _refuse(error)
        # Clients that see the token may send queries, so a handler may run from here on: no signal may interrupt it.
        stop.set_up()
        for instance in instances:
            bus.declare_live(name, instance)
        if needs_later:
            import_in_background(*needs_later)
        log.info("ready", instances=list(instances), listening=list(bus.listening), lab=config.bus.lab, metrics=metrics)
        stop.wait()
        log.info("ending", why=stop.reason)
        # First, so that no handler uses the context of `build` while it is closed.
        bus.stop_serving()
    log.info("ended")


def service_main(
    name: str,
    config_type: type[ServiceConfigT],
    build: Callable[[ServiceConfigT], Build],
    *,
    instances: Callable[[ServiceConfigT], Sequence[str]] = lambda _: (MAIN_INSTANCE,),
    needs_later: Sequence[str] = (),
) -> None:
    """Run a service from the command line: `python -m <name> --config FILE`; see `configured` for the environment.

    Parameters
    ----------
    name : str
        Name of the service.
    config_type : type
        Type of its configuration.
    build : callable
        Takes the configuration and returns the function that `run_service` calls with the bus.
    instances : callable, optional
        Takes the configuration and returns the instances to declare live.
    needs_later : sequence of str
        Modules that its work needs and its start does not: imported after it is ready.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {name}", description=f"The {name} of a Duralab lab.")
    parser.add_argument("--config", type=Path, metavar="FILE", help="YAML file; the defaults where not given")
    path: Path | None = parser.parse_args().config
    try:
        config = configured(config_type, path)
    except ConfigError as error:
        _refuse(error)
    run_service(name, config, build(config), instances=instances(config), needs_later=needs_later)
    # Everything is closed and written. Daemon threads of handlers and native libraries may still hold a lock, also that
    # of the log: the interpreter's normal exit would sometimes abort on it.
    sys.stderr.flush()
    os._exit(0)


def _refuse(error: Exception) -> NoReturn:
    sys.stderr.write(f"{error}\n")
    raise SystemExit(EXIT_MISCONFIGURED) from error


class _StopSignal:
    """Requests to end the process: signals, or the end of standard input.

    A signal handler may interrupt any code, also the taking of a lock; so it only sets a flag and writes to a socket.
    """

    def __init__(self, log: structlog.typing.FilteringBoundLogger) -> None:
        self._log = log
        self._waiting = False
        self._stopped = False
        # Sockets: Windows does not accept a pipe for the bytes of signals.
        self._main_reads, self._main_writes = socket.socketpair()
        self._signal_reads, self._signal_writes = socket.socketpair()
        self.reason = ""

    def listen(self, *, standard_input: bool) -> None:
        # Python's own handlers wait until the main thread returns from native code, which may build a plant or wait for
        # a connection; the byte in this socket does not wait.
        self._signal_writes.setblocking(False)
        signal.set_wakeup_fd(self._signal_writes.fileno())
        threading.Thread(target=self._watch, name="duralab_bus-watchdog", daemon=True).start()
        ending = [signal.SIGTERM, signal.SIGINT]
        if sys.platform == "win32":
            # Sent when a console is closed, and by Ctrl-Break.
            ending.append(signal.SIGBREAK)
        else:
            # With a handler the signal writes its byte and does not end the process.
            signal.signal(signal.SIGUSR1, lambda _number, _frame: None)
        for number in ending:
            signal.signal(number, self._on_signal)
        if standard_input:
            threading.Thread(target=self._follow_parent, name="duralab_bus-parent", daemon=True).start()

    def set_up(self) -> None:
        """From now on, only note a signal until `wait` reads it."""
        self._waiting = True

    def wait(self) -> None:
        self._main_reads.recv(1)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if self._stopped:
            return
        self._stopped = True
        self.reason = self.reason or signal.Signals(number).name
        self._main_writes.send(b"!")
        if not self._waiting:
            # During the set-up nothing reads the socket yet.
            raise SystemExit(0)

    def _follow_parent(self) -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        self.reason = "the parent process ended"
        # The same path as for a signal, on the main thread.
        if sys.platform == "win32":
            signal.raise_signal(signal.SIGTERM)
        else:
            os.kill(os.getpid(), signal.SIGTERM)

    def _watch(self) -> None:
        """Log the threads' call stacks on request; force the end of a process that does not end in time."""
        if sys.platform == "win32":
            self._signal_reads.recv(1)
        else:
            while self._signal_reads.recv(1)[0] == signal.SIGUSR1:
                log_stacks()
        # The system may have given the signal to any thread, e.g. while the main one was about to take another signal.
        # Python's handler runs on the main thread only, which would continue to wait.
        self._main_writes.send(b"!")
        time.sleep(_EXIT_SECONDS)
        self._log.error("Something is stuck; the process ends without it.", after_seconds=_EXIT_SECONDS)
        os._exit(EXIT_STUCK)


# Options of mallopt, from malloc.h of the GNU C library.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8
_LARGEST_IN_A_HEAP: Final = 32 * 2**20  # largest value that the GNU C library allows


def keep_few_arenas(count: int, *, kept_bytes: int | None = None) -> bool:
    """Limit the heaps that all threads started from now on share.

    The GNU C library gives threads up to eight heaps a core. A service that starts a thread for each piece of work, of
    tens of megabytes each, eventually holds that much in every heap: hundreds of unused megabytes.

    Parameters
    ----------
    count : int
        Number of heaps, 1 or more.
    kept_bytes : int, optional
        Freed memory that a heap keeps for later use; then arrays of up to 32 MiB are taken from heaps. If a library,
        such as Dask, has set MALLOC_TRIM_THRESHOLD_ in the environment, each array is otherwise requested from the
        system page by page and returned at once: a fifth of a campaign's processor time.

    Returns
    -------
    bool
        Whether the C library accepted the values; libraries other than GNU's do not have or need them.

    Raises
    ------
    ValueError
        If `count` is less than 1.
    """
    if count < 1:
        raise ValueError(f"{count} heaps are asked for; a process has 1 or more.")
    mallopt = None if sys.platform == "win32" else getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    wanted = [(_M_ARENA_MAX, count)]
    if kept_bytes is not None:
        wanted += [(_M_MMAP_THRESHOLD, _LARGEST_IN_A_HEAP), (_M_TRIM_THRESHOLD, kept_bytes)]
    return all(mallopt(option, value) == 1 for option, value in wanted)
