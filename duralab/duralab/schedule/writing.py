"""Text of a schedule file."""

from __future__ import annotations

import os
from pathlib import Path

from duralab_schedules import Schedule
from duralab_settings import dump_yaml


def schedule_text(schedule: Schedule, *, folder: Path) -> str:
    """Return the text of a schedule file.

    Parameters
    ----------
    schedule : Schedule
        Schedule to write; keys at their default are omitted.
    folder : Path
        Folder of the file, the base of its relative paths.

    Returns
    -------
    str
        YAML text from which `load_schedule` reads the same schedule.
    """
    content = schedule.model_dump(mode="json", exclude_defaults=True)
    targets = [*content["events"].values(), *content.get("plan", {}).get("mix", {}).values()]
    for section in targets:
        for key in ("drive", "target"):
            # The id of a recording is not a path and is unchanged.
            if key in section and (schedule.folder / section[key]).exists():
                section[key] = Path(os.path.relpath(schedule.folder / section[key], folder)).as_posix()
    return dump_yaml(content)
