"""Operator page as a separate process of a lab: start, restart after an unexpected end, and stop."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from duralab.errors import InputError, LabError
from duralab.processes.supervisor import close_quietly, describe_exit, last_lines, require_services
from duralab.processes.viewer import require_free_port
from duralab_settings import dump_yaml

PAGE_PORT: Final = 7480
START_SECONDS: Final = 60.0
END_SECONDS: Final = 4.0
AGAIN_SECONDS: Final = 1.0
"""Delay before the restart of a page that ended unexpectedly; no campaign depends on the page."""

_HOST: Final = "127.0.0.1"
_POLL_SECONDS: Final = 0.1


class OperatorPage:
    """Operator page of a lab on 127.0.0.1, for a `with` statement; the lab does not depend on it.

    `endpoint`: Endpoint of the lab. `folder`: Folder for campaign files, uploads and reports. `port`: 0 for a free one.
    """

    def __init__(self, endpoint: str, *, folder: Path, log: Path, port: int = 0, viewer: str | None = None) -> None:
        require_services("operator_page")
        self._port = require_free_port(port, option="--page-port")
        self._log = log
        self._configs = Path(tempfile.mkdtemp(prefix="duralab-page-"))
        self._config = self._configs / "operator_page.yaml"
        content = {
            "bus": {"connect": [endpoint]},
            "exit_with_parent": True,
            "host": _HOST,
            "port": self._port,
            "folder": str(folder.resolve()),
            "viewer": viewer,
        }
        self._config.write_text(dump_yaml(content), encoding="utf-8")
        self._ending = threading.Event()
        self._process = self._spawn()
        try:
            self._wait_until_it_answers()
        except BaseException:
            self.stop()
            raise
        self._guard = threading.Thread(target=self._keep, name="duralab-page", daemon=True)
        self._guard.start()

    @property
    def address(self) -> str:
        """Address to open in a browser."""
        return f"http://{_HOST}:{self._port}/"

    @property
    def process_id(self) -> int:
        """Process id of the page."""
        return self._process.pid

    def _spawn(self) -> subprocess.Popen[bytes]:
        self._log.parent.mkdir(parents=True, exist_ok=True)
        with self._log.open("ab") as log:
            try:
                return subprocess.Popen(
                    [sys.executable, "-m", "operator_page", "--config", str(self._config)],
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            except OSError as error:
                raise LabError(f"The operator page could not be started: {error.strerror or error}.") from error

    def _wait_until_it_answers(self) -> None:
        deadline = time.monotonic() + START_SECONDS
        while True:
            with socket.socket() as probe:
                probe.settimeout(0.2)
                if probe.connect_ex((_HOST, self._port)) == 0:
                    return
            if (code := self._process.poll()) is not None:
                said = last_lines(self._log).rstrip(".")
                raise InputError(
                    f"The operator page ended at once ({describe_exit(code)}): {said}; correct that, or leave "
                    "--page out."
                )
            if time.monotonic() > deadline:
                raise LabError(f"The page did not start within {START_SECONDS:g} s: {last_lines(self._log)}.")
            time.sleep(_POLL_SECONDS)

    def _keep(self) -> None:
        while not self._ending.is_set():
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_POLL_SECONDS)
            if self._process.poll() is not None and not self._ending.wait(AGAIN_SECONDS):
                close_quietly(self._process.stdin)
                with suppress(LabError):
                    self._process = self._spawn()

    def stop(self) -> None:
        """Stop the page."""
        self._ending.set()
        if (guard := getattr(self, "_guard", None)) is not None:
            guard.join()
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_SECONDS)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        close_quietly(self._process.stdin)
        shutil.rmtree(self._configs, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
