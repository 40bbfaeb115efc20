"""Calls of the services as programs: list shipped rigs, rebuild a recording's live view, verify a recording."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from duralab.errors import InputError, LabError
from duralab.near_files import did_you_mean
from duralab.output_files import recording_in
from duralab_settings import open_regular

_SECONDS: Final = 30.0


def shipped_rigs() -> dict[str, str]:
    """Return the specimen of each shipped rig, as text, by the rig's name; empty if no simulator is installed."""
    asked = [sys.executable, "-m", "rig_sim", "--list"]
    try:
        answer = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=_SECONDS).stdout
        return dict(json.loads(answer))
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}


def require_shipped(rigs: Sequence[str], *, usual: Sequence[str]) -> None:
    """Check the rigs before the start of a lab; no query is needed for those that every lab has (`usual`)."""
    if set(rigs) <= set(usual):
        return
    shipped = shipped_rigs()
    unknown = [name for name in rigs if name not in shipped]
    # Without a simulator there is no list; the start of the lab reports the error.
    if shipped and unknown:
        raise InputError(
            f"There is no rig {', '.join(map(repr, unknown))} to start a lab with; there are {', '.join(shipped)}.",
            field="rig",
        )


_RECORDING: Final = b"\x89MCAP"
_LIVE_VIEW: Final = b"RRF"


def is_recording(file: Path) -> bool:
    """Return whether a file is a recording, not a live view, by its first bytes; its name is not reliable."""
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
        shown = start.decode("ascii", "backslashreplace")
        raise InputError(
            f"{file} starts with '{shown}' and is neither a live view nor a recording; give a live.rrd or a "
            "recording.mcap."
        )
    return start.startswith(_RECORDING)


def rebuilt_view(recording: Path, target: Path, *, report: Callable[[str], None]) -> Path:
    """Write the live view of a recording; call `report` with a sentence if the recording is unfinished."""
    from duralab.processes.supervisor import last_lines, require_services
    from duralab.recording import RecordingFiles

    file = RecordingFiles(recording)
    if not file.whole:
        report(f"{recording} was never finished; it is shown as far as it is whole.")
    said = target.with_suffix(".log")
    require_services("recorder")
    # A separate process, because the SDK imports no service, and Rerun does not free its memory.
    with said.open("wb") as log:
        code = subprocess.run(
            [sys.executable, "-m", "recorder.rebuild_view", *map(str, file.paths), "--out", str(target)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            check=False,
        ).returncode
    if code != 0:
        # The reason is in the recorder's sentence, after the recording's name.
        _, known, reason = last_lines(said).rpartition(" cannot be shown: ")
        kind = InputError if known else LabError
        raise kind(f"The live view of {recording} cannot be made: {reason.rstrip('.')}.")
    return target


def findings_of(recording: Path) -> list[str]:
    """Check a whole recording, or that in the folder of a campaign; return a sentence for each defect."""
    recording = recording_in(recording)
    if not is_recording(recording):
        raise InputError(f"{recording} is a live view; give the recording.mcap beside it.")
    from duralab.processes.supervisor import require_services

    require_services("recorder")
    # A separate process, because the SDK imports no service.
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
