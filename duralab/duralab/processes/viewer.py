"""Rerun live viewer, on loopback only: a window if there is a display, otherwise a page for the browser."""

from __future__ import annotations

import importlib.util
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Final, Self
from urllib.parse import quote

from duralab.errors import InputError, LabError
from duralab.near_files import did_you_mean
from duralab.processes.supervisor import LAB_EXTRA, close_quietly, describe_exit, last_lines

GRPC_PORT: Final = 9876
WEB_PORT: Final = 9090
START_SECONDS: Final = 20.0
END_SECONDS: Final = 5.0
MEMORY_LIMIT: Final = "2GB"
"""Memory limit of the viewer, and of its server for the browser."""

_HOST: Final = "127.0.0.1"


class Viewer:
    """Running viewer on 127.0.0.1, optionally with an .rrd file; for a `with` statement.

    `port`, `web_port`: 0 for a free port. `native`: Whether to open a window instead of a page for the browser at
    `web_port`; by default if there is a display.
    """

    def __init__(
        self,
        *,
        port: int = GRPC_PORT,
        web_port: int = WEB_PORT,
        native: bool | None = None,
        file: Path | None = None,
    ) -> None:
        if file is not None and not file.is_file():
            raise InputError(f"There is no file {str(file)!r}; give the path of a live.rrd{did_you_mean(file)}")
        program = viewer_program()
        self.native = has_display() if native is None else native
        if not self.native and port == web_port != 0:
            raise InputError(f"--port and --web-port are both {port}; give two different ports.", field="web_port")
        self._port = require_free_port(port, option="--port")
        self._web_port = self._port if self.native else require_free_port(web_port, option="--web-port")
        self._folder = Path(tempfile.mkdtemp(prefix="duralab-viewer-"))
        # A separate configuration with analytics off; the user's configuration is unchanged.
        environment = {**os.environ, "XDG_CONFIG_HOME": str(self._folder)}
        self._log = self._folder / "viewer.log"
        with self._log.open("wb") as log:
            subprocess.run([str(program), "analytics", "disable"], env=environment, stdout=log, stderr=log, check=False)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "duralab.processes.viewer_guard", str(program), *self._arguments(file)],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        try:
            self._wait_until_ready()
        except BaseException:
            self.stop()
            raise

    def _arguments(self, file: Path | None) -> list[str]:
        files = [str(file)] if file is not None else []
        # Beyond its memory limit the viewer drops the oldest data.
        common = ["--bind", _HOST, "--port", str(self._port), "--hide-welcome-screen", *files]
        common = ["--memory-limit", MEMORY_LIMIT, "--server-memory-limit", MEMORY_LIMIT, *common]
        return common if self.native else ["--serve-web", "--web-viewer-port", str(self._web_port), *common]

    @property
    def address(self) -> str:
        """Address for sending data."""
        return f"rerun+http://{_HOST}:{self._port}/proxy"

    @property
    def page(self) -> str | None:
        """Address to open in a browser; None for a window."""
        if self.native:
            return None
        return f"http://{_HOST}:{self._web_port}/?url={quote(self.address, safe='')}"

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + START_SECONDS
        # The two ports open in either order.
        while not (_answers(self._port) and _answers(self._web_port)):
            code = self._process.poll()
            if code is not None:
                raise LabError(f"The viewer ended at once ({describe_exit(code)}): {last_lines(self._log)}.")
            if time.monotonic() > deadline:
                raise LabError(f"The viewer did not start within {START_SECONDS:g} s: {last_lines(self._log)}.")
            time.sleep(0.05)

    def wait(self, timeout_seconds: float) -> bool:
        """Wait for the viewer's end; return whether it was closed within the time."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_seconds)
        return self._process.poll() is not None

    def stop(self) -> None:
        """Close the viewer and its program."""
        close_quietly(self._process.stdin)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_SECONDS)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def viewer_program() -> Path:
    """Return the viewer's binary, not its wrapper script, whose end would leave the binary running."""
    package = importlib.util.find_spec("rerun_cli")
    for folder in (package.submodule_search_locations or []) if package is not None else []:
        for name in ("rerun", "Rerun.app/Contents/MacOS/Rerun", "rerun.exe"):
            if (Path(folder) / name).is_file():
                return Path(folder) / name
    raise InputError(f"The Rerun viewer is not installed here; install it with {LAB_EXTRA}, or leave --view out.")


def has_display() -> bool:
    """Return whether a window can be opened."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def require_free_port(port: int, *, option: str) -> int:
    """Return a port if it is free, or a free port for 0."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError as error:
            raise InputError(
                f"The port {port} of {_HOST} is in use; close what uses it, or give another with {option}."
            ) from error
        return probe.getsockname()[1]


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((_HOST, port)) == 0
