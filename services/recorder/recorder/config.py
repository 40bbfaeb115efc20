"""Configuration of a recorder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, Field

from duralab_bus import ServiceConfig

_VIEWER = re.compile(r"rerun(\+http|\+https)?://[A-Za-z0-9.\-\[\]:]+/proxy")
VIEWER_EXAMPLE: Final = "rerun+http://127.0.0.1:9876/proxy"


def _check_viewer(viewer: str | None) -> str | None:
    if viewer is not None and _VIEWER.fullmatch(viewer) is None:
        raise ValueError(f"the viewer {viewer!r} is not the address of a Rerun server, e.g. '{VIEWER_EXAMPLE}'")
    return viewer


class RecorderConfig(ServiceConfig):
    """Configuration of a recorder."""

    # Folder of the recordings; made if it does not exist.
    folder: Path = Path("recordings")
    # A file of this size is finished, and the recording continues in the next file without a gap.
    split_size_mebibytes: Annotated[int, Field(ge=1, le=1024 * 1024)] = 512
    # No playback is begun, and no interrupted recording resumed, while less space is free on the folder's disk.
    least_free_mebibytes: Annotated[int, Field(ge=0, le=1024 * 1024)] = 256
    # Address of a Rerun viewer that shows everything live; the recorder itself opens no port.
    viewer: Annotated[str | None, AfterValidator(_check_viewer)] = None
    # Whether <recording>.rrd is written beside <recording>.mcap: what the viewer showed.
    live_file: bool = True
    # Whether the lab is so new that its bus has no other recorder: the start does not wait to discover one.
    new_lab: bool = False
