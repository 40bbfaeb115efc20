"""A lab for the pages that are written from what it says: `duralab up` on a free port."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def shared_lab(folder: Path, *options: str, rigs: Sequence[str] = ("front_axle", "predecessor")) -> Iterator[str]:
    """Start the lab and yield its endpoint; it ends with the block. `options`: Further ones of `duralab up`."""
    folder.mkdir(parents=True, exist_ok=True)
    places = {name: str(folder) for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR")}
    named = [word for rig in rigs for word in ("--rig", rig)]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "duralab",
            "up",
            "--listen",
            "tcp/127.0.0.1:0",
            "--recordings",
            folder,
            *named,
            *options,
        ],
        env={**os.environ, **places},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    try:
        said = ""
        while (found := re.search(r"tcp/127\.0\.0\.1:\d+", said)) is None:
            line = process.stdout.readline()
            assert line, said
            said += line
        yield found[0]
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
