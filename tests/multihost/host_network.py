"""Hosts on this machine: a network namespace each, and a cable from each to a switch, which can be cut and worsened."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from .wire_process import MTU

HOSTS = ("router", "rig", "control", "viewer")
_SWITCH = "switch"
_SCRIPT = Path(__file__).with_name("wire_process.py")
_END_SECONDS = 5.0


def why_not() -> str:
    """Return why this machine cannot have such hosts; empty where it can."""
    if os.geteuid() != 0:
        return "only root may make network namespaces"
    if shutil.which("ip") is None:
        return "there is no ip (Debian: apt install iproute2)"
    if not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        return "there is no /dev/net/tun"
    tried = subprocess.run(["unshare", "--net", "true"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"no network namespaces here: {tried.stderr.strip()}"


class HostNetwork:
    """The hosts; use it in a `with` statement.

    Parameters
    ----------
    name : str
        Begins the names of the namespaces; unique on this machine.
    seed : int
        Decides which frames are lost.
    """

    def __init__(self, name: str, *, seed: int = 1) -> None:
        self._name = name
        self._seed = seed
        self._wires: dict[str, subprocess.Popen[str]] = {}
        self._made: list[str] = []

    def __enter__(self) -> HostNetwork:
        try:
            self._make(_SWITCH)
            self._ip(_SWITCH, "link", "add", "bridge", "mtu", str(MTU), "type", "bridge")
            self._ip(_SWITCH, "link", "set", "bridge", "up")
            for number, host in enumerate(HOSTS):
                self._make(host)
                self._lay_wire(host, number)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for wire in self._wires.values():
            assert wire.stdin is not None
            assert wire.stdout is not None
            wire.stdin.close()
            wire.stdout.close()
            wire.wait(_END_SECONDS)
        for namespace in self._made:
            subprocess.run(["ip", "netns", "delete", namespace], check=True)
        self._wires, self._made = {}, []

    def namespace(self, host: str) -> str:
        """Return the name of a host's network namespace."""
        return f"{self._name}-{host}"

    def address(self, host: str) -> str:
        """Return the address of a host."""
        return f"10.77.0.{HOSTS.index(host) + 1}"

    def on(self, host: str, command: Sequence[str]) -> list[str]:
        """Return what runs a command on a host."""
        return ["ip", "netns", "exec", self.namespace(host), *command]

    def change(self, host: str, **settings: float | bool) -> None:
        """Change the cable of a host: `delay`, `loss`, `rate`, `cut`; see wire_process.py."""
        wire = self._wires[host]
        assert wire.stdin is not None
        wire.stdin.write(json.dumps(settings) + "\n")
        wire.stdin.flush()

    def _make(self, host: str) -> None:
        subprocess.run(["ip", "netns", "add", self.namespace(host)], check=True)
        self._made.append(self.namespace(host))
        self._ip(host, "link", "set", "lo", "up")

    def _lay_wire(self, host: str, number: int) -> None:
        arguments = [self.namespace(host), "cable", self.namespace(_SWITCH), f"port{number}", str(self._seed + number)]
        wire = subprocess.Popen(
            [sys.executable, str(_SCRIPT), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._wires[host] = wire
        assert wire.stdout is not None
        if not wire.stdout.readline().startswith("ready"):
            raise RuntimeError(f"The cable of {host} could not be laid.")
        self._ip(_SWITCH, "link", "set", f"port{number}", "master", "bridge")
        self._ip(host, "address", "add", f"{self.address(host)}/24", "dev", "cable")

    def _ip(self, host: str, *arguments: str) -> None:
        subprocess.run(["ip", "-n", self.namespace(host), *arguments], check=True)
