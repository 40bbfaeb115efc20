"""Notes of the labs that `duralab up` runs for this user on this machine, one file each.

A note is valid only while its writer runs: the process id and the start time must both match, so that a later process
with the same id is not taken for a lab.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import psutil

from duralab.errors import InputError, LabError

END_SECONDS: Final = 30.0
"""Longest time for a lab to end; its services take some seconds if a rig ramps down."""

_BEGAN_WITHIN: Final = 0.5
"""Tolerance of a process's start time, in seconds; two readings differ by less."""

_SUFFIX: Final = ".json"


@dataclass(frozen=True)
class RunningLab:
    """Lab of a running `duralab up`; `process_began` is the start of its process, in seconds since 1970 UTC."""

    endpoint: str
    process_id: int
    process_began: float
    host: str
    recordings: str
    services: dict[str, int]

    def runs(self) -> bool:
        """Return whether the process that wrote the note still runs."""
        try:
            process = psutil.Process(self.process_id)
            # An ended process keeps its id until its parent reads its exit code.
            ended = process.status() == psutil.STATUS_ZOMBIE
            began = process.create_time()
        except psutil.Error:
            return False
        return not ended and abs(began - self.process_began) < _BEGAN_WITHIN


def notes_folder() -> Path:
    """Return the folder of the notes, in the user's state folder."""
    if sys.platform == "win32":
        given = os.environ.get("LOCALAPPDATA")
        base = Path(given) if given else Path.home() / "AppData" / "Local"
    else:
        given = os.environ.get("XDG_STATE_HOME")
        # The XDG specification requires relative paths to be ignored.
        base = Path(given) if given and Path(given).is_absolute() else Path.home() / ".local" / "state"
    return base / "duralab" / "labs"


@contextmanager
def noted(endpoint: str, *, recordings: Path, services: dict[str, int]) -> Iterator[str | None]:
    """Write a note about a lab of this process for the `with` statement; yield the error if it failed, or None."""
    lab = RunningLab(
        endpoint=endpoint,
        process_id=os.getpid(),
        process_began=psutil.Process().create_time(),
        host=socket.gethostname(),
        recordings=str(recordings.resolve()),
        services=services,
    )
    path = notes_folder() / f"{lab.host}-{lab.process_id}{_SUFFIX}"
    fault = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(asdict(lab), indent=2), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        fault = f"{path.parent} cannot be written ({error.strerror}): `duralab down` will not find this lab."
    try:
        yield fault
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def running_labs() -> list[RunningLab]:
    """Return the labs that run on this machine, by endpoint; remove the notes of ended labs."""
    found = []
    for path in sorted(notes_folder().glob(f"*{_SUFFIX}")):
        lab = _read(path)
        if lab is None or lab.host != socket.gethostname():
            continue
        if lab.runs():
            found.append(lab)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)
    return sorted(found, key=lambda lab: lab.endpoint)


def _read(path: Path) -> RunningLab | None:
    """Return the lab of a note; None if the file is not a note."""
    try:
        lab = RunningLab(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    sound = isinstance(lab.process_id, int) and lab.process_id > 0 and isinstance(lab.process_began, float)
    return lab if sound and isinstance(lab.endpoint, str) else None


def the_running_lab() -> RunningLab | None:
    """Return the one running lab, None if there is none; raises InputError if several labs run."""
    labs = running_labs()
    if len(labs) > 1:
        listed = ", ".join(lab.endpoint for lab in labs)
        raise InputError(
            f"{len(labs)} labs run here: {listed}; name one of them with --connect, or as connect()'s endpoint.",
            field="connect",
        )
    return labs[0] if labs else None


def require_no_lab(endpoint: str, *, recordings: Path) -> None:
    """Refuse to start a lab if another one of this user has the same endpoint or recordings folder."""
    labs = running_labs()
    folder = str(recordings.resolve())
    lab = next((lab for lab in labs if endpoint == lab.endpoint or folder == lab.recordings), None)
    if lab is None:
        return
    down = "duralab down" if len(labs) == 1 else f"duralab down --connect {lab.endpoint}"
    raise InputError(
        f"Your lab runs already at {lab.endpoint} (process {lab.process_id}, recordings in {lab.recordings}); end it "
        f"with `{down}`, or start a second one with another --listen and another --recordings.",
        field="listen" if endpoint == lab.endpoint else "recordings",
    )


def end_lab(lab: RunningLab, *, timeout_seconds: float = END_SECONDS) -> None:
    """Terminate a lab and wait for its end; raises LabError if it is another user's or does not end in time."""
    try:
        process = psutil.Process(lab.process_id)
        # Check again; if the id is reused after this line, psutil refuses to signal the new process.
        if not lab.runs():
            return
        process.terminate()
        process.wait(timeout_seconds)
    except psutil.NoSuchProcess:
        return
    except psutil.AccessDenied as error:
        raise LabError(
            f"The lab at {lab.endpoint} (process {lab.process_id}) belongs to another user, who has to end it."
        ) from error
    except psutil.TimeoutExpired as error:
        if not lab.runs():
            return
        raise LabError(
            f"The lab at {lab.endpoint} (process {lab.process_id}) did not end within {timeout_seconds:g} s; look at "
            f"its logs in {lab.recordings}, and end the process by hand."
        ) from error
