"""Drive map of a campaign: checked against its rig, learned from a playback, applied to a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map import DriveMap, LearnedDriveMap, learn_drive_map
from duralab_spectra import rms
from iterator.assessment import partial_playbacks
from iterator.band import ControlBand
from iterator.limits import DriveLimits, require_rest_within_limits
from iterator.model import RigModel, equivalent_drive
from iterator.updates import UpdateSettings, stated_rate_limits


@dataclass(frozen=True)
class MapFromFirstPlayback:
    """Drive map that is learned from the first playback, or again from the first at full level if there is one.

    Parameters
    ----------
    names, units : tuple of str
        Names and units of the drives, in the rig's order.
    may_follow : tuple of bool, optional
        Whether each drive may follow products, i.e. is under displacement control; all if not given.
    start : DriveMap, optional
        Map of the identification, for the first playbacks. It stays if the playback adds no information: see
        `duralab_drive_map.learn_drive_map`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    may_follow: tuple[bool, ...] | None = None
    start: DriveMap | None = None

    def number(self, levels: Sequence[float]) -> int:
        """Return the number of the playback to learn from.

        A playback at partial level is too quiet to improve a map. None of them is in the history of the playbacks
        after the first one at full level, so that no drive has to be mapped again.
        """
        return 1 if self.start is None else partial_playbacks(levels) + 1


def learned_map(
    drive: NDArray[np.float64],
    response: NDArray[np.float64],
    to_learn: MapFromFirstPlayback,
    *,
    model: RigModel,
    target: NDArray[np.float64],
    controlled: NDArray[np.bool_],
    limits: DriveLimits | None,
    update: UpdateSettings,
) -> LearnedDriveMap[RigModel]:
    """Learn a drive map from the first playback; return the earlier map with a remark if the limits do not allow it."""
    learned = learn_drive_map(
        drive,
        response,
        model=model,
        names=to_learn.names,
        units=to_learn.units,
        response_weight=np.divide(1.0, rms(target), out=np.zeros(len(target)), where=controlled),
        start=to_learn.start,
        may_follow=to_learn.may_follow,
    )
    try:
        fitting_map(learned.drive_map, model, limits, update=update)
    except ValueError as error:
        before = to_learn.start or replace(learned.drive_map, terms=())
        return replace(learned, drive_map=before, chosen=(), remarks=(*learned.remarks, f"{error}."))
    return learned


def fitting_map(
    drive_map: DriveMap | None, model: RigModel, limits: DriveLimits | None, *, update: UpdateSettings
) -> DriveMap | None:
    """Return a drive map that fits model and limits, or None for the identity.

    Where the rig states the speed of an actuator, drives that follow it follow its motion.
    """
    if drive_map is None:
        return None
    drive_map.require_model(model)
    if limits is not None:
        drive_map.require_drives(limits.names, limits.units, sample_rate=limits.sample_rate)
        require_rest_within_limits(drive_map, limits)
    if drive_map.is_identity:
        return None
    stated = stated_rate_limits(limits, update)
    if not stated:
        return drive_map

    def moved(drive: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        row = equivalent_drive(samples[None, :], stated[drive : drive + 1], sample_rate=drive_map.sample_rate)
        return np.asarray(row[0], dtype=np.float64)

    return replace(drive_map, moved=moved)


def mapped_drive(
    drive: NDArray[np.float64], drive_map: DriveMap | None, *, band: ControlBand | None = None
) -> NDArray[np.float64]:
    """Return a drive in the coordinates of updates; give `band` for a drive that was made without the map.

    The part of its `T(u)` outside the band would stay in every later drive; a drive that is made with the map has its
    mapped drive in the band already.
    """
    if drive_map is None:
        return drive
    mapped = drive_map.to_mapped(drive)
    return mapped if band is None else band.limit_drive(mapped)
