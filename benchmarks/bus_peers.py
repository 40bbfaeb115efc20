"""Start and end of the processes of `bus_process.py`."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).with_name("bus_process.py")


class Peer:
    """A process of `bus_process.py`."""

    def __init__(self, role: str, **settings: object) -> None:
        self.role = role
        self.process = subprocess.Popen(
            [sys.executable, str(SCRIPT), json.dumps({"role": role, **settings})],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def read(self) -> Any:
        """Return the process's next output."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline().strip()
        if not line:
            raise RuntimeError(f"The {self.role} of the benchmark ended unexpectedly; run it alone to see why.")
        return line if line == "ready" else json.loads(line)

    def tell(self, line: str) -> None:
        """Send a line to the process."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()


@contextmanager
def peers() -> Iterator[Callable[..., Peer]]:
    """Start processes, and end them all."""
    started: list[Peer] = []

    def start(role: str, **settings: object) -> Peer:
        started.append(Peer(role, **settings))
        return started[-1]

    try:
        yield start
    finally:
        for peer in started:
            peer.end()
