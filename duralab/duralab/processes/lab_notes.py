"""Notes of the labs that `duralab up` runs for this user on this machine, one file each.

A note is believed only while the process that wrote it runs: its id and the moment it began must both fit, so that no
other process that got the same id later is taken for a lab.
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
"""Longest time for a lab to end; its services take some seconds where a rig ramps down."""

_BEGAN_WITHIN: Final = 0.5
"""Two readings of when a process began differ by less, in seconds."""

_SUFFIX: Final = ".json"


@dataclass(frozen=True)
class RunningLab:
    """A lab that `duralab up` keeps running in a process that began at a time, in seconds since 1970 UTC, on a host."""

    endpoint: str
    process_id: int
    process_began: float
    host: str
    recordings: str
    services: dict[str, int]

    def runs(self) -> bool:
        """Return whether the process that wrote the note is still there."""
        try:
            process = psutil.Process(self.process_id)
            # One that has ended and whose parent has not asked how keeps its id.
            ended = process.status() == psutil.STATUS_ZOMBIE
            began = process.create_time()
        except psutil.Error:
            return False
        return not ended and abs(began - self.process_began) < _BEGAN_WITHIN


def notes_folder() -> Path:
    """Return where the notes are: in the user's own folder for the state of programs."""
    if sys.platform == "win32":
        given = os.environ.get("LOCALAPPDATA")
        base = Path(given) if given else Path.home() / "AppData" / "Local"
    else:
        given = os.environ.get("XDG_STATE_HOME")
        # The specification of that variable has relative paths ignored.
        base = Path(given) if given and Path(given).is_absolute() else Path.home() / ".local" / "state"
    return base / "duralab" / "labs"


@contextmanager
def noted(endpoint: str, *, recordings: Path, services: dict[str, int]) -> Iterator[str | None]:
    """Note a lab of this process for as long as the `with` statement; give why it could not be, or None."""
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
    """Return the labs that run on this machine, by endpoint; notes of others that are gone are removed."""
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
    """Return what a note says; None where it is no note."""
    try:
        lab = RunningLab(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    sound = isinstance(lab.process_id, int) and lab.process_id > 0 and isinstance(lab.process_began, float)
    return lab if sound and isinstance(lab.endpoint, str) else None


def the_running_lab() -> RunningLab | None:
    """Return the one lab that runs, None where none does; raises InputError where several do."""
    labs = running_labs()
    if len(labs) > 1:
        listed = ", ".join(lab.endpoint for lab in labs)
        raise InputError(
            f"{len(labs)} labs run here: {listed}; name one of them with --connect, or as connect()'s endpoint.",
            field="connect",
        )
    return labs[0] if labs else None


def require_no_lab(endpoint: str, *, recordings: Path) -> None:
    """Refuse to start a lab where one of this user listens at the same endpoint or records into the same folder."""
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
    """Ask a lab to end and wait; raises LabError where it belongs to another user or does not end in time."""
    try:
        process = psutil.Process(lab.process_id)
        # Asked again: psutil itself refuses to signal a process that took over the id since this line.
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
