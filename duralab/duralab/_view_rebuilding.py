"""The live view of a recording whose .rrd is lost, made again from its log by the recorder's own code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from duralab._supervisor import last_lines
from duralab.errors import LabError
from duralab.mcap_reading import McapFile


def rebuilt_view(recording: Path, target: Path) -> Path:
    """Write the live view of a recording and return its path.

    Parameters
    ----------
    recording : Path
        The first .mcap file; those that follow lie beside it.
    target : Path
        The .rrd to write.

    Raises
    ------
    InputError
        There is no such file, or it is no recording.
    LabError
        The recorder's code failed; with the last lines that it said.
    """
    files = McapFile(recording).paths
    said = target.with_suffix(".log")
    # A process of its own: the SDK imports no service, and Rerun keeps what it took.
    with said.open("wb") as log:
        code = subprocess.run(
            [sys.executable, "-m", "recorder.rebuild_view", *map(str, files), "--out", str(target)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            check=False,
        ).returncode
    if code != 0:
        raise LabError(f"The live view of {recording} cannot be made: {last_lines(said)}.")
    return target
