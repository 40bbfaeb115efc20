"""Playbacks as an update sees them with a drive map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iterator.band import ControlBand
from iterator.drive_map.drive_map import DriveMap
from iterator.model import Playback


def mapped_playback(playback: Playback, *, drive_map: DriveMap, band: ControlBand | None = None) -> Playback:
    """Return a playback with its mapped drive in place of its drive; updates work on it as it is.

    `playback`: As played. `drive_map`: `T`. `band`: Given for a playback that was made before the map was learned: its
    mapped drive is limited to the band. What `T(u)` has outside of it would otherwise be kept in every drive that
    follows. A drive that was made with the map stays as it is, because its mapped drive is in the band.
    Returns: The playback itself where the map is the identity.
    Raises `ValueError`: The drive does not have the map's channels.
    """
    if drive_map.is_identity:
        return playback
    mapped = drive_map.to_mapped(playback.drive)
    if band is None:
        return replace(playback, drive=mapped)
    transform = band.transform(mapped.shape[1])
    mask = band.drive_mask(transform.frequency)
    lines = np.empty(mask.size, dtype=np.complex128)
    for row in mapped:
        transform.lines(row, weight=mask, out=lines)
        transform.samples(lines, out=row)
    return replace(playback, drive=mapped)
