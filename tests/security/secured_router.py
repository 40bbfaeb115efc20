"""The router of a secured lab as a process, from the configuration that `duralab certs router` writes."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from duralab.security import read_refusals
from duralab.security.router_log import Refusal

from .members import CONFIGURATION_FILE

ROOT = Path(__file__).resolve().parents[2]
START_SECONDS = 60.0
LOGGED_SECONDS = 20.0
AUDIT_LOG = "warn,zenoh_link_tls::unicast=debug,zenoh::net::routing::interceptor::access_control=trace"
"""What RUST_LOG says where refusals are to be logged, as docs/security.md has it."""


def zenohd() -> str | None:
    """Return the path of the real router's binary, where this machine has one."""
    named = os.environ.get("DURALAB_ZENOHD")
    at_home = Path.home() / ".cargo" / "bin" / "zenohd"
    return named or shutil.which("zenohd") or (str(at_home) if at_home.is_file() else None)


class SecuredRouter:
    """Runs a router; use it in a `with` statement.

    Parameters
    ----------
    certificates : Path
        Folder with `ca.crt`, the pair of `router.main` and the configuration.
    log : Path
        Where its log goes.
    configuration : Path, optional
        Another zenohd configuration; certificates and port are put in the place of those in it.
    rust_log : str
        What it logs.
    """

    def __init__(
        self,
        certificates: Path,
        *,
        log: Path,
        configuration: Path | None = None,
        rust_log: str = AUDIT_LOG,
    ) -> None:
        self.port = free_port()
        self.log = log
        self._configuration = configuration or certificates / CONFIGURATION_FILE
        self._environment = {**os.environ, "RUST_LOG": rust_log, "NO_COLOR": "1"}
        self._overrides: dict[str, Any] = {
            "listen/endpoints": {"router": [self.endpoint]},
            "transport/link/tls/root_ca_certificate": str(certificates / "ca.crt"),
            "transport/link/tls/listen_certificate": str(certificates / "router.main.crt"),
            "transport/link/tls/listen_private_key": str(certificates / "router.main.key"),
        }
        self._process: subprocess.Popen[str] | None = None

    @property
    def endpoint(self) -> str:
        """Where it listens."""
        return f"tls/127.0.0.1:{self.port}"

    def __enter__(self) -> SecuredRouter:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start it, again where it was stopped, and wait until it accepts links."""
        binary = zenohd()
        if binary is None:
            script = Path(__file__).with_name("router_process.py")
            command = [sys.executable, str(script), str(self._configuration), json.dumps(self._overrides)]
        else:
            settings = [f"--cfg={key}:{json.dumps(value)}" for key, value in self._overrides.items()]
            command = [binary, "--config", str(self._configuration), *settings]
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=log, stderr=log, text=True, env=self._environment
            )
        deadline = time.monotonic() + START_SECONDS
        while not self._accepts():
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"The router did not start: {self.lines()[-3:]}")
            time.sleep(0.05)

    def stop(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._process = None

    def lines(self) -> list[str]:
        """Return what it has logged, without colours."""
        text = self.log.read_text(encoding="utf-8", errors="replace")
        return re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines()

    def refusals(self, enough: Callable[[list[Refusal]], bool]) -> list[Refusal]:
        """Return what it refused as soon as that is enough, or after 20 s: a put is refused after it has returned."""
        deadline = time.monotonic() + LOGGED_SECONDS
        while True:
            refused = list(read_refusals(self.lines()))
            if enough(refused) or time.monotonic() > deadline:
                return refused
            time.sleep(0.05)

    def _accepts(self) -> bool:
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=1.0):
                return True
        except OSError:
            return False


def free_port() -> int:
    """Return a port of 127.0.0.1 that nobody uses now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port
