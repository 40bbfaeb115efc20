"""The figures of the recorder: what waits for the disk, for how long, how much room there is, and what is missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

from labbus import FigureKind, Metrics
from recorder.log import Archive, Intake
from recorder.work_thread import WorkThread

_NO_LABELS: Final[tuple[str, ...]] = ()


def follow_recorder(
    metrics: Metrics,
    folder: Path,
    archive: Archive,
    intake: Intake,
    writer: WorkThread,
    *,
    missing: Callable[[], int],
) -> None:
    """Tell of a recorder; all of it may be read on any thread.

    Parameters
    ----------
    metrics : Metrics
        Of the process.
    folder : Path
        Where recordings go.
    archive, intake, writer
        What is told of.
    missing : callable
        Returns how many blocks no recording got, since the start.
    """
    readings: tuple[tuple[str, str, Callable[[], float]], ...] = (
        ("waiting_jobs", "What waits for the writer's thread", lambda: writer.waiting),
        ("intake_bytes", "What was received and is not on the disk yet", lambda: intake.bytes),
        ("lag_seconds", "For how long the oldest of it has waited", lambda: intake.lag_seconds),
        ("open_recordings", "Recordings that are written", lambda: archive.counts()[0]),
        ("interrupted_recordings", "Recordings whose disk takes nothing", lambda: archive.counts()[1]),
        ("free_bytes", "Room on the disk of the recordings", lambda: shutil.disk_usage(folder).free),
    )
    for name, what, read in readings:
        metrics.follow(f"duralab_recorder_{name}", what, lambda read=read: {_NO_LABELS: float(read())})
    metrics.follow(
        "duralab_recorder_missing_blocks_total",
        "Signal blocks that no recording got",
        lambda: {_NO_LABELS: float(missing())},
        kind=FigureKind.COUNTER,
    )
