"""The secured lab on several hosts: the router on one, the rig on another, what computes and stores on a third."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import yaml

from duralab.security import MemberEntry, configure_router, init_authority, issue_missing
from duralab_bus import BusConfig, BusMode, TlsConfig, open_bus
from duralab_proto.members import ROUTER, Role

from ..faults.lab_under_fault import HUB, RIG, SERVICES, VEHICLE, LabUnderFault
from .host_network import HostNetwork

ROOT = Path(__file__).resolve().parents[2]
PORT = 7447
CONTROL = ("identifier", "iterator", "sequencer", "recorder")
HOST_OF = {HUB: "router", "rig_sim": "rig", **dict.fromkeys(CONTROL, "control")}
ROLE_OF = {"rig_sim": Role.RIG, **{name: Role(name) for name in CONTROL}}
_ROUTER = ROOT / "tests" / "security" / "router_process.py"
_VIEWER = Path(__file__).with_name("viewing_process.py")
_START_SECONDS = 60.0


class LabOnHosts(LabUnderFault):
    """Starts the lab; the script that makes it is on the control host itself.

    Parameters
    ----------
    folder : Path
        For certificates, recordings, configurations and logs.
    network : HostNetwork
        Its hosts.
    """

    def __init__(self, folder: Path, network: HostNetwork) -> None:
        super().__init__(folder)
        self.network = network
        self._certificates = folder / "certificates"
        self._certificates.mkdir(parents=True)
        init_authority(self._certificates)
        members = (
            MemberEntry(role=ROUTER, name="main", hosts=(network.address("router"),)),
            *(MemberEntry(role=role, name="main", rigs=(RIG, VEHICLE) if role is Role.RIG else ()) for role in Role),
        )
        issue_missing(self._certificates, members)
        self._router_configuration = folder / "zenohd.json5"
        self._router_configuration.write_text(
            configure_router(self._certificates, members, certificates=str(self._certificates))
        )

    @property
    def endpoint(self) -> str:
        """Where the router listens."""
        return f"tls/{self.network.address('router')}:{PORT}"

    def __enter__(self) -> LabOnHosts:
        try:
            self.start(HUB)
            joining = BusConfig.model_validate(self._joining("operator"))
            self.bus = open_bus(joining, service="operator")
            for name in SERVICES:
                self.start(name)
            self.wait_until_whole()
            self.start_viewer()
        except BaseException:
            self.__exit__()
            raise
        return self

    def start(self, name: str) -> None:
        """Start a part of the lab on its host; the router is ready when this returns."""
        with (self._folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                self.network.on(HOST_OF[name], self._command(name)),
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=self._environment,
            )
        if name == HUB:
            self._wait_for_router()

    def start_viewer(self) -> None:
        """Start a script on the viewer's host that watches everything a viewer may."""
        command = [sys.executable, str(_VIEWER), json.dumps(self._joining("viewer"))]
        self._processes["viewer"] = subprocess.Popen(
            self.network.on("viewer", command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=self._environment
        )

    def viewed_blocks(self) -> int:
        """End the viewer and return how many signal blocks it saw."""
        process = self._processes.pop("viewer")
        said, _ = process.communicate(timeout=_START_SECONDS)
        # What it logs goes before.
        return int(said.splitlines()[-1])

    def _command(self, name: str) -> list[str]:
        if name == HUB:
            return [sys.executable, str(_ROUTER), str(self._router_configuration), "{}"]
        config = self._folder / f"{name}.yaml"
        config.write_text(yaml.safe_dump(self._configuration(self._plans[name])))
        return [sys.executable, "-m", name, "--config", str(config)]

    def _configuration(self, plan: Any) -> dict[str, Any]:
        return {"bus": self._joining(ROLE_OF[plan.name]), "exit_with_parent": True, **plan.settings}

    def _joining(self, role: str) -> dict[str, Any]:
        tls = TlsConfig.of(self._certificates / f"{role}.main")
        return {
            "mode": BusMode.CLIENT.value,
            "connect": [self.endpoint],
            "connect_timeout_seconds": _START_SECONDS,
            "tls": {name: str(path) for name, path in tls.model_dump().items()},
        }

    def _wait_for_router(self) -> None:
        deadline = time.monotonic() + _START_SECONDS
        probe = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 1.0).close()"
        command = self.network.on("router", [sys.executable, "-c", probe, self.network.address("router"), str(PORT)])
        while subprocess.run(command, capture_output=True, env=dict(os.environ), check=False).returncode != 0:
            if time.monotonic() > deadline or self.dead():
                raise TimeoutError(f"The router did not start: {self.dead()}")
            time.sleep(0.1)
