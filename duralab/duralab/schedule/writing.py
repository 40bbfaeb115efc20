"""A schedule as the text of its file."""

from __future__ import annotations

import os
from pathlib import Path

import yaml

from duralab_schedules import Schedule


def schedule_text(schedule: Schedule, *, folder: Path) -> str:
    """Return the text of a schedule file.

    Parameters
    ----------
    schedule : Schedule
        What is written; keys at their default are left out.
    folder : Path
        Where the file is to stand: relative paths are written from there.

    Returns
    -------
    str
        YAML that `load_schedule` reads as the same schedule.
    """
    content = schedule.model_dump(mode="json", exclude_defaults=True)
    targets = [*content["events"].values(), *content.get("plan", {}).get("mix", {}).values()]
    for section in targets:
        for key in ("drive", "target"):
            # An id of a recording is no path, and stays.
            if key in section and (schedule.folder / section[key]).exists():
                section[key] = Path(os.path.relpath(schedule.folder / section[key], folder)).as_posix()
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
