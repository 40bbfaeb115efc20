"""Services of a lab as child processes: start together, monitor, and end all."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from threading import Thread
from types import MappingProxyType
from typing import IO, Final, Self

from duralab.errors import PROCESS_LIMIT, InputError, LabError, ServiceEndedError, is_process_limit
from duralab.processes.service_process import UNKNOWN_EXIT, ServiceProcess, start_service
from duralab_bus import Bus, SpanKind, import_in_background, span
from duralab_proto.keys import MAIN_INSTANCE
from duralab_settings import dump_yaml

START_SECONDS: Final = 90.0
"""Longest time to wait for all services; a rig compiles its model at its first start."""

END_SECONDS: Final = 3.5
"""Longest time until a service ends; it needs at most 3 s after the signal."""

LOG_LINES: Final = 3
"""Number of last log lines in an error."""

LAB_EXTRA: Final = "pip install 'duralab[lab]'"
"""Command that installs all services of a lab; `duralab` alone is a client of running labs."""

_POLL_SECONDS: Final = 0.01
# Stack traces of Zenoh's threads may follow the relevant line; 17 kB were seen.
_TAIL_BYTES: Final = 1_048_576
_TRACE_LINES: Final = (
    "Traceback (most recent",
    "During handling of the",
    "The above exception",
    "stack backtrace:",
    "note:",
)


@dataclass(frozen=True)
class ServicePlan:
    """Service to start with `python -m <name> --config FILE`, and the instances that it declares live."""

    name: str
    instances: tuple[str, ...] = (MAIN_INSTANCE,)
    settings: Mapping[str, object] = field(default_factory=dict)


def require_services(*names: str) -> None:
    """Check that this Python has the services; otherwise raise LabError with the command to install them."""
    missing = [name for name in names if find_spec(name) is None]
    if missing:
        raise LabError(
            f"This Python, {sys.executable}, has no {', '.join(missing)}, which a lab on this machine needs; install "
            f"the services with {LAB_EXTRA}, or name a lab that runs already with --connect."
        )


def lab_services(
    *,
    rigs: Sequence[str],
    recordings: Path,
    viewer: str | None,
    specimens: Mapping[str, Path] = MappingProxyType({}),
    live_file: bool = True,
    real_time: bool = False,
    endurance: bool = False,
    new_lab: bool = True,
) -> tuple[ServicePlan, ...]:
    """Return the services of a lab in the order of their start; the recorder starts and ends last.

    `specimens`: YAML files of further rigs, by the rig's name. `live_file`: Whether the recorder also writes a file for
    the viewer. `endurance`: Whether to include a sequencer. `new_lab`: Whether the bus was just opened at a free port,
    so that it has no other members. Raises LabError if one of them is not installed.
    """
    plans = (
        ServicePlan(
            "rig_sim",
            instances=(*rigs, *specimens),
            # Beside the recordings, so that data that a killed rig had not delivered is fetched at the next start.
            settings={
                "rigs": list(rigs),
                "specimens": [str(path) for path in specimens.values()],
                "spool_folder": str(recordings.resolve() / "spool"),
                "wear_folder": str(recordings.resolve() / "wear"),
                "real_time": real_time,
            },
        ),
        ServicePlan("identifier"),
        ServicePlan("iterator"),
        *((ServicePlan("sequencer", settings={"held_folder": str(recordings.resolve() / "held")}),) * endurance),
        ServicePlan(
            "recorder",
            settings={
                "folder": str(recordings.resolve()),
                "viewer": viewer,
                "live_file": live_file,
                "new_lab": new_lab,
            },
        ),
    )
    require_services(*(plan.name for plan in plans))
    return plans


class Supervisor:
    """Supervisor that starts services and ends them, the last one after the others; for a `with` statement.

    The services end if this process is killed, because they hold the other end of a pipe. They connect to `bus`, which
    listens. `trace_folder`: Folder for the services' time traces; no traces if not given.
    """

    def __init__(self, plans: Sequence[ServicePlan], *, bus: Bus, logs: Path, trace_folder: Path | None = None) -> None:
        self._plans = tuple(plans)
        self._bus = bus
        self._logs = logs
        self._trace_folder = trace_folder
        self._configs = Path(tempfile.mkdtemp(prefix="duralab-"))
        self._processes: dict[str, ServiceProcess] = {}
        self._ending: Thread | None = None

    @property
    def process_ids(self) -> dict[str, int]:
        """Process id of each started service."""
        return {name: process.pid for name, process in self._processes.items()}

    def start(
        self, *, needs_later: Sequence[str | Callable[[], None]] = (), timeout_seconds: float = START_SECONDS
    ) -> None:
        """Start all services and wait until all are on the bus; raises LabError with the last lines of a log.

        `needs_later`: Modules that this process imports while it waits, and functions that are called between.
        """
        try:
            self._logs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"The folder {self._logs} cannot be made: {error.strerror}; give another.") from error
        with span("start the services", SpanKind.START):
            first, *others = self._plans
            self._processes[first.name] = self._spawn(first)
            import_in_background(*needs_later)
            for plan in others:
                self._processes[plan.name] = self._spawn(plan)
            self._wait(timeout_seconds)

    def _wait(self, timeout_seconds: float) -> None:
        wanted = {(plan.name, instance) for plan in self._plans for instance in plan.instances}
        deadline = time.monotonic() + timeout_seconds
        while missing := wanted - self._bus.live():
            if (ended := self.failure()) is not None:
                raise ended
            if time.monotonic() > deadline:
                names = sorted({service for service, _ in missing})
                lines = " | ".join(f"{name}: {last_lines(self.log_path(name))}" for name in names)
                raise LabError(
                    f"Not on the bus {timeout_seconds:g} s after the start: {', '.join(names)}; "
                    f"last in the log: {lines}."
                )
            time.sleep(_POLL_SECONDS)

    def _spawn(self, plan: ServicePlan) -> ServiceProcess:
        config = self._configs / f"{plan.name}.yaml"
        bus = {"lab": self._bus.config.lab, "connect": list(self._bus.listening[:1])}
        content = {"bus": bus, "exit_with_parent": True, **plan.settings}
        if self._trace_folder is not None:
            content["trace_folder"] = str(self._trace_folder.resolve())
        config.write_text(dump_yaml(content), encoding="utf-8")
        log = self.log_path(plan.name)
        log.write_bytes(b"")
        try:
            return start_service(plan.name, config=config, log=log)
        except OSError as error:
            reason = PROCESS_LIMIT if is_process_limit(error) else f"{error.strerror or error}; free memory"
            raise LabError(f"The process of the service {plan.name} could not be started: {reason}.") from error

    def log_path(self, name: str) -> Path:
        """Return the path of a service's log."""
        return self._logs / f"{name}.log"

    def failure(self) -> ServiceEndedError | None:
        """Return the error of a service that ended unexpectedly, or None while all run or are being ended."""
        if self._ending is not None:
            return None
        for name, process in self._processes.items():
            if (code := process.poll()) is not None:
                log = self.log_path(name)
                last = last_lines(log).rstrip(".")
                # Later panics of Rust may fill the last lines.
                if is_process_limit(_tail(log)):
                    found = f": it could not start a thread, {PROCESS_LIMIT}; its log is {log}"
                else:
                    found = f"; last in its log {log}: {last}"
                return ServiceEndedError(
                    f"The service {name} ended by itself ({describe_exit(code)}){found}.", service=name
                )
        return None

    def begin_stop(self) -> None:
        """Begin to end all services, and return at once; `stop` waits for the end."""
        if self._ending is None:
            self._ending = Thread(target=self._end_all, name="duralab-stop")
            self._ending.start()

    def stop(self) -> None:
        """End all services within a few seconds, by force if necessary."""
        if self._ending is not None:
            self._ending.join()
        else:
            self._end_all()

    def _end_all(self) -> None:
        *first, last = (plan.name for plan in self._plans)
        with span("stop the services", SpanKind.START):
            for names in (first, [last]):
                self._end([self._processes[name] for name in names if name in self._processes])
        shutil.rmtree(self._configs, ignore_errors=True)

    @staticmethod
    def _end(processes: Sequence[ServiceProcess]) -> None:
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + END_SECONDS
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
        for process in processes:
            if process.poll() is None:
                process.kill()
            process.wait()
            close_quietly(process.stdin)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def close_quietly(stream: IO[bytes] | None) -> None:
    """Close a pipe whose other end may be closed."""
    if stream is not None:
        with suppress(OSError):
            stream.close()


def describe_exit(code: int) -> str:
    """Return an exit code as text."""
    if code == UNKNOWN_EXIT:
        return "exit code unknown"
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def last_lines(path: Path) -> str:
    """Return the last lines of a log as one line: of JSON lines the event and its error, without stack traces."""
    lines = [_readable(line.strip()) for line in _tail(path).splitlines() if line.strip() and not _is_trace(line)]
    return " / ".join([line for line, _ in groupby(lines)][-LOG_LINES:]) or "none"


def _tail(path: Path) -> str:
    """Return the end of a log; empty if it cannot be read."""
    try:
        with path.open("rb") as stream:
            stream.seek(max(0, stream.seek(0, 2) - _TAIL_BYTES))
            return stream.read().decode("utf-8", errors="replace")
    except OSError:
        return ""


def _is_trace(line: str) -> bool:
    """Return whether a line of a log is part of a stack trace of Python or Rust, except its message."""
    return line[0].isspace() or line.startswith(_TRACE_LINES)


def _readable(line: str) -> str:
    try:
        entry = json.loads(line)
    except ValueError:
        return line
    if not isinstance(entry, dict) or "event" not in entry:
        return line
    details = [str(entry[key]) for key in ("error", "exception") if key in entry]
    return ": ".join([str(entry["event"]), *(detail.strip().splitlines()[-1] for detail in details if detail.strip())])
