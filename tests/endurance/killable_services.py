"""Rig, sequencer and recorder as processes of their own that are killed and started again."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import yaml

from duralab_bus import Bus, BusConfig, BusError, FaultError, open_bus
from duralab_proto.v1 import health_pb2

from .counting_rig import RIG

SERVICES = ("rig_sim", "sequencer", "recorder")
_INSTANCES = {"rig_sim": RIG}
_MODULES = {"rig_sim": "tests.endurance.counting_rig"}
_ROOT = Path(__file__).parents[2]


class KillableServices:
    """Starts the services in a folder; use it in a `with` statement."""

    bus: Bus

    def __init__(self, folder: Path, *, settings: dict[str, dict[str, Any]] | None = None) -> None:
        self._folder = folder
        self.recordings = folder / "recordings"
        self.ledger = folder / "ledger"
        self._settings: dict[str, dict[str, Any]] = {
            "rig_sim": {"ledger": str(self.ledger), "spool_folder": str(folder / "spool")},
            "sequencer": {},
            "recorder": {"folder": str(self.recordings), "live_file": False},
        }
        for name, more in (settings or {}).items():
            self._settings[name] |= more
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> KillableServices:
        self._folder.mkdir(parents=True, exist_ok=True)
        self.ledger.touch()
        self.bus = open_bus(BusConfig(), service="test")
        try:
            for name in SERVICES:
                self.start(name)
            self.wait_until_whole()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(5.0)
            process.kill()
            process.wait()
            process.stdin.close()
        self.bus.close()

    def start(self, name: str) -> None:
        """Start a service, again where it was killed."""
        config = self._folder / f"{name}.yaml"
        bus = {"connect": [self.bus.listening[0]], "connect_timeout_seconds": 60.0}
        config.write_text(yaml.safe_dump({"bus": bus, "exit_with_parent": True, **self._settings[name]}))
        with (self._folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", _MODULES.get(name, name), "--config", str(config)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=_ROOT,
            )

    def kill(self, name: str) -> None:
        """End a service as `kill -9` does."""
        process = self._processes[name]
        process.kill()
        process.wait()
        process.stdin.close()

    def resident_mebibytes(self) -> dict[str, float]:
        """Return the resident memory of each service."""
        return {name: psutil.Process(each.pid).memory_info().rss / 2**20 for name, each in self._processes.items()}

    def wait_until_whole(self, timeout_seconds: float = 180.0) -> None:
        """Wait until every service answers."""
        deadline = time.monotonic() + timeout_seconds
        for name in SERVICES:
            while not self._answers(name):
                if time.monotonic() > deadline or self._processes[name].poll() is not None:
                    raise TimeoutError(f"{name} does not answer; its log is in {self._folder}.")
                time.sleep(0.05)

    def _answers(self, name: str) -> bool:
        key = self.bus.keys.health(name, _INSTANCES.get(name, "main"))
        try:
            self.bus.query(key, health_pb2.HealthRequest(), health_pb2.Health, silence_seconds=3.0)
        except (FaultError, BusError):
            return False
        return True

    def defects(self) -> list[str]:
        """Return the lines of the services' logs that tell of defects."""
        lines = [line for name in SERVICES for line in (self._folder / f"{name}.log").read_text().splitlines()]
        return [line[:1000] for line in lines if "Traceback" in line or "panicked" in line]
