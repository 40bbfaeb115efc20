"""Drive files of a project: one per event, one of all events joined by blends, and the order file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab.campaign import Project
from duralab.data import Signals
from duralab.formats import write_signals
from duralab.lab.known_before import best_playback
from duralab.lab.project_result import EventResult
from duralab.output_files import replace_when_complete

_BLEND_SECONDS: Final = 0.5
"""Duration of the blend between two drives in the file of all events."""


def write_drives(project: Project, results: Sequence[EventResult], folder: Path) -> Path | None:
    """Write the best drive of each event that reached its target, per rig; return the first order file, None if none.

    `folder`: Output folder, with a folder for each rig. Its files: `<event>.drv`; `<project>.seq` with a line for each
    event, in the order of the project file: repeats, seconds, file; `<project>.drv` with each event once, joined by
    blends. A rig without any such event has neither, also none of an earlier run.
    """
    order_files = []
    by_name = {result.event.name: result for result in results}
    for rig in dict.fromkeys(event.campaign.rig for event in project.events):
        lines = [f"# Drives of project {project.name} on rig {rig}: repeats, seconds, file."]
        drives: list[Signals] = []
        for event in project.events:
            done = by_name.get(event.name)
            if done is None or event.campaign.rig != rig:
                continue
            if done.result is None or not done.reached:
                why = "ended early" if done.result is None else done.result.verdict.judgement.value
                lines.append(f"# {event.name} is left out: {why}")
                continue
            drive, _ = best_playback(done.result.recording, name=event.name, field="event")
            drive = replace(drive, attributes={"TIME_TYPE": "DRIVE"})
            file = f"{event.name}.drv"
            write_signals(drive, folder / rig / file, overwrite=True)
            lines.append(f"{event.settings.repeats} {drive.duration:.6g} {file}")
            drives.append(drive)
        order, joined = (folder / rig / f"{project.name}.{ending}" for ending in ("seq", "drv"))
        if not drives:
            for stale in (order, joined):
                stale.unlink(missing_ok=True)
            continue
        whole = replace(drives[0], samples=blended([drive.samples for drive in drives], drives[0].sample_rate))
        write_signals(whole, joined, overwrite=True)
        with replace_when_complete(order) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
        order_files.append(order)
    return order_files[0] if order_files else None


def blended(drives: Sequence[NDArray[np.float64]], sample_rate: float) -> NDArray[np.float64]:
    """Join drives by raised cosines from the last sample of each to the first of the next."""
    count = round(_BLEND_SECONDS * sample_rate)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / (count + 1))
    parts = [drives[0]]
    for before, after in pairwise(drives):
        parts += [before[:, -1:] + (after[:, :1] - before[:, -1:]) * rise, after]
    return np.concatenate(parts, axis=1)
