"""What is wrong with a recording's files that lie in no recorder's folder, by the recorder's own code."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from duralab._view_rebuilding import is_recording
from duralab.errors import InputError, LabError


def findings_of(recording: Path) -> list[str]:
    """Read a recording from end to end and return what is wrong with it.

    Parameters
    ----------
    recording : Path
        Its first .mcap file; those that follow lie beside it.

    Returns
    -------
    list of str
        A sentence for each; empty where it is whole.

    Raises
    ------
    InputError
        There is no such file, or it is no recording.
    LabError
        The recorder's code failed; with what it said.
    """
    if not is_recording(recording):
        raise InputError(f"{recording} is a live view; give the recording.mcap beside it.")
    # A process of its own: the SDK imports no service.
    done = subprocess.run(
        [sys.executable, "-m", "recorder.verify_file", str(recording)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()[-1:] or [f"it ended with {done.returncode}"]
        raise LabError(f"The recording {recording} could not be verified: {said[0].rstrip('.')}.")
    return [str(finding) for finding in json.loads(done.stdout)]
