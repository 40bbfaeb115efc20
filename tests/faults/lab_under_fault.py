"""A real lab of separate processes whose every part can be killed, frozen, cut off and started again."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from enum import StrEnum
from pathlib import Path
from typing import Any

import psutil
import yaml

from duralab.processes import ServicePlan, lab_services
from duralab_bus import Bus, BusConfig, BusError, BusMode, FaultError, open_bus
from duralab_proto.v1 import health_pb2

from .cuttable_link import CuttableLink

RIG = "front_axle_compliant"
VEHICLE = "predecessor"
HUB = "hub"
SERVICES = ("rig_sim", "identifier", "iterator", "sequencer", "recorder")
START_SECONDS = 120.0
_POLL_SECONDS = 0.05
_END_SECONDS = 5.0
_LONGEST_LINE = 1000
_MOST_DEFECTS = 10


class Topology(StrEnum):
    """How the sessions of a lab are connected."""

    EMBEDDED = "embedded"
    """Peers that found each other through a hub, as `duralab up` has it: they talk directly."""
    ROUTED = "routed"
    """Clients of one router, each through a link of its own that can be cut: nothing passes but through it."""


class LabUnderFault:
    """Starts the services, a hub and links as child processes; use it in a `with` statement.

    Parameters
    ----------
    folder : Path
        For configurations and logs.
    topology : Topology
        How they are connected.
    recordings : Path, optional
        The recorder's folder; `folder/recordings` where not given.
    environment : mapping, optional
        Added to the services' own.
    rigs : sequence of str
        That the simulator serves.
    """

    bus: Bus

    def __init__(
        self,
        folder: Path,
        *,
        topology: Topology = Topology.EMBEDDED,
        recordings: Path | None = None,
        environment: Mapping[str, str] | None = None,
        rigs: Sequence[str] = (RIG, VEHICLE),
    ) -> None:
        self.recordings = recordings or folder / "recordings"
        self._folder = folder
        self._topology = topology
        self._environment = {**os.environ, "OMP_NUM_THREADS": "1", **(environment or {})}
        self._hub_port = _free_port()
        self._rigs = tuple(rigs)
        self._plans = {
            plan.name: plan
            for plan in lab_services(rigs=self._rigs, recordings=self.recordings, viewer=None, endurance=True)
        }
        self._processes: dict[str, subprocess.Popen[Any]] = {}
        self._log_read: dict[str, int] = {}
        self.links: dict[str, CuttableLink] = {}

    @property
    def endpoint(self) -> str:
        """Where the hub listens."""
        return f"tcp/127.0.0.1:{self._hub_port}"

    def __enter__(self) -> LabUnderFault:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self.start(HUB)
            if self._topology is Topology.ROUTED:
                self.links = {name: CuttableLink(self._hub_port) for name in SERVICES}
            mode = BusMode.CLIENT if self._topology is Topology.ROUTED else BusMode.PEER
            self.bus = open_bus(BusConfig(mode=mode, connect=(self.endpoint,)), service="faults")
            for name in SERVICES:
                self.start(name)
            self.wait_until_whole()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for link in self.links.values():
            link.heal()
        for process in self._processes.values():
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self._processes.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_SECONDS)
            process.kill()
            process.wait()
            _close(process)
        if hasattr(self, "bus"):
            self.bus.close()
        for link in self.links.values():
            link.close()

    def start(self, name: str) -> None:
        """Start a part of the lab, again where it was killed; returns before it is ready, except for the hub."""
        if name == HUB:
            mode = BusMode.ROUTER if self._topology is Topology.ROUTED else BusMode.PEER
            script = Path(__file__).with_name("session_process.py")
            self._processes[name] = start_script(script, mode.value, self.endpoint)
            return
        config = self._folder / f"{name}.yaml"
        config.write_text(yaml.safe_dump(self._configuration(self._plans[name])))
        with (self._folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", name, "--config", str(config)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=self._environment,
            )

    def _configuration(self, plan: ServicePlan) -> dict[str, Any]:
        bus: dict[str, Any] = {"connect": [self.endpoint]}
        if self._topology is Topology.ROUTED:
            bus = {"mode": BusMode.CLIENT.value, "connect": [f"tcp/127.0.0.1:{self.links[plan.name].port}"]}
        # A loaded machine and a router that comes back at the same moment: longer than a user would wait.
        return {"bus": {**bus, "connect_timeout_seconds": 60.0}, "exit_with_parent": True, **plan.settings}

    def kill(self, name: str) -> None:
        """End a part as `kill -9` does, and wait until the system has taken it away."""
        process = self._processes[name]
        process.kill()
        process.wait()
        _close(process)

    def end(self, name: str) -> int:
        """Tell a service to end, as whoever installs a new version of it does; return its exit code."""
        process = self._processes[name]
        process.terminate()
        code = process.wait(_END_SECONDS)
        _close(process)
        return code

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Stop a part as a debugger or a machine without memory does; it goes on afterwards."""
        process = self._processes[name]
        process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            process.send_signal(signal.SIGCONT)

    def dead(self) -> list[str]:
        """Return the parts that have ended."""
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def process_id(self, name: str) -> int:
        return self._processes[name].pid

    def resident_mebibytes(self) -> dict[str, float]:
        """Return the resident memory of each service."""
        return {name: psutil.Process(self.process_id(name)).memory_info().rss / 2**20 for name in SERVICES}

    def defects(self) -> list[str]:
        """Return what the services' logs tell of defects since the last time: exceptions that nobody foresaw."""
        found: dict[str, int] = {}
        for name in SERVICES:
            with (self._folder / f"{name}.log").open("rb") as log:
                log.seek(self._log_read.get(name, 0))
                lines = log.read()
                self._log_read[name] = log.tell()
            for line in lines.decode(errors="replace").splitlines():
                if "Traceback" in line or "panicked" in line:
                    what = f"the log of {name} tells of a defect: …{line[-_LONGEST_LINE:]}"
                    found[what] = found.get(what, 0) + 1
        return [f"{what} ({count} times)" for what, count in found.items()][:_MOST_DEFECTS]

    def wait_until_whole(self, timeout_seconds: float = START_SECONDS) -> None:
        """Wait until every service answers: one that has just ended counts as live until it is sure not to come back.

        Raises
        ------
        TimeoutError
            Naming what is wrong with whom.
        """
        deadline = time.monotonic() + timeout_seconds
        wanted = {*(("rig_sim", rig) for rig in self._rigs), *((name, "main") for name in SERVICES[1:])}
        while True:
            try:
                for service, instance in sorted(wanted):
                    self.bus.query(
                        self.bus.keys.health(service, instance),
                        health_pb2.HealthRequest(),
                        health_pb2.Health,
                        silence_seconds=3.0,
                    )
                return
            except (FaultError, BusError) as fault:
                if time.monotonic() > deadline or self.dead():
                    raise TimeoutError(f"The lab is not whole: {fault}; ended: {self.dead()}") from fault
            time.sleep(_POLL_SECONDS)


def start_script(script: Path, *arguments: str) -> subprocess.Popen[str]:
    """Start a script of this folder and wait until it says that it is ready."""
    process = subprocess.Popen(
        [sys.executable, str(script), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    if not process.stdout.readline().startswith("ready"):
        raise RuntimeError(f"{script.name} {' '.join(arguments)} did not start.")
    return process


def end_script(process: subprocess.Popen[str]) -> None:
    """End a script, frozen or not."""
    process.kill()
    process.wait()
    _close(process)


def _close(process: subprocess.Popen[Any]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port
