"""The live view of a recording whose .rrd is lost, made again from its log by the recorder's own code."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from duralab.errors import InputError, LabError
from duralab.near_files import did_you_mean
from duralab.processes.supervisor import last_lines
from duralab.recording import RecordingFiles
from duralab_settings import open_regular

_RECORDING: Final = b"\x89MCAP"
_LIVE_VIEW: Final = b"RRF"


def is_recording(file: Path) -> bool:
    """Return whether a file is a recording, and not a live view, by its first bytes: a name may say anything.

    `file`: The file.
    Returns: True for a recording, False for a live view.
    Raises `InputError`: There is no such file, it is a folder, it cannot be read, or it is neither.
    """
    try:
        with open_regular(file) as stream:
            start = stream.read(len(_RECORDING))
    except IsADirectoryError as error:
        raise InputError(f"{str(file)!r} is a folder; give the path of a live.rrd or a recording.mcap.") from error
    except (FileNotFoundError, ValueError) as error:
        guess = did_you_mean(file)
        raise InputError(
            f"There is no file {str(file)!r}; give the path of a live.rrd or a recording.mcap{guess}"
        ) from error
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}; give a live.rrd or a recording.mcap.") from error
    if not start.startswith((_RECORDING, _LIVE_VIEW)):
        raise InputError(
            f"{file} starts with {start!r} and is neither a live view nor a recording; give a live.rrd or a "
            "recording.mcap."
        )
    return start.startswith(_RECORDING)


def rebuilt_view(recording: Path, target: Path, *, tell: Callable[[str], None]) -> Path:
    """Write the live view of a recording and return its path.

    `recording`: The first .mcap file; those that follow lie beside it. `target`: The .rrd to write. `tell`: Told in a
    sentence where it ends before the recording's end.
    Returns: Path of the live view.
    Raises `InputError`: There is no such file, it is no recording, or it holds nothing that can be shown. `LabError`:
    The recorder's code failed; with the last lines that it said.
    """
    file = RecordingFiles(recording)
    if not file.whole:
        tell(f"{recording} was never finished; it is shown as far as it is whole.")
    said = target.with_suffix(".log")
    # A process of its own: the SDK imports no service, and Rerun keeps what it took.
    with said.open("wb") as log:
        code = subprocess.run(
            [sys.executable, "-m", "recorder.rebuild_view", *map(str, file.paths), "--out", str(target)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            check=False,
        ).returncode
    if code != 0:
        # The recorder says it in a sentence of its own; of that, what comes after the recording's name is the reason.
        _, known, reason = last_lines(said).rpartition(" cannot be shown: ")
        kind = InputError if known else LabError
        raise kind(f"The live view of {recording} cannot be made: {reason.rstrip('.')}.")
    return target


def findings_of(recording: Path) -> list[str]:
    """Read a recording from end to end and return what is wrong with it.

    `recording`: Its first .mcap file; those that follow lie beside it.
    Returns: A sentence for each; empty where it is whole.
    Raises `InputError`: There is no such file, or it is no recording. `LabError`: The recorder's code failed; with what
    it said.
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
