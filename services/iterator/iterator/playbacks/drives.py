"""Playable next drive: from rest to rest, within the limits, and with a prediction within the bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map import DriveMap
from duralab_settings import LimitPolicy
from iterator.assessment import PlaybackBoundError, is_bounded, judge_response, passed_bound
from iterator.band import DRIVE_FADE_SECONDS, faded
from iterator.limits import (
    DriveLimits,
    DriveProjection,
    drive_within_limits,
    project_drive,
    project_mapped_drive,
    require_small_overrun,
    require_within_limits,
    wanted_drive,
)
from iterator.model import IterationHistory, RigModel, predict
from iterator.playbacks.settings import CampaignSettings
from iterator.updates import NextDrive


def playable_drive(
    step: NextDrive,
    *,
    level: float,
    limits: DriveLimits | None,
    settings: CampaignSettings,
    drive_map: DriveMap | None,
    first: bool,
) -> tuple[NDArray[np.float64], DriveProjection | None]:
    """Return the next drive at its level, from rest to rest and within the limits, and its changes for the limits."""
    band = settings.update.band
    whole = faded(step.drive, sample_rate=band.sample_rate, seconds=DRIVE_FADE_SECONDS)
    drive = level * whole

    def at_rest(_i: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        # A drive that follows others rings for about as long as its map is cut off above the identified band.
        return faded(row[None, :].copy(), sample_rate=band.sample_rate, seconds=DRIVE_FADE_SECONDS)[0]

    if limits is None:
        return drive if drive_map is None else drive_map.to_drive(drive, adjust=at_rest), None
    if settings.limit_policy is LimitPolicy.PROJECT:
        if first:
            if drive_map is not None:
                whole = wanted_drive(whole, drive_map=drive_map, limits=limits, band=band)
            require_small_overrun(whole, limits=limits, allowed=settings.largest_overrun)
        if drive_map is None:
            projection = project_drive(drive, limits=limits, band=band)
        else:
            projection = project_mapped_drive(drive, drive_map=drive_map, limits=limits, band=band, adjust=at_rest)
        return projection.drive, projection
    last, gains = None if step.stepped_from is None else level * step.stepped_from, settings.update.gains
    if drive_map is None:
        require_within_limits(drive, last_drive=last, limits=limits, iteration_gain=gains)
    else:
        drive = drive_within_limits(
            drive, last_mapped=last, drive_map=drive_map, limits=limits, iteration_gain=gains, adjust=at_rest
        )
    return drive, None


def require_within_bounds(
    drive: NDArray[np.float64],
    model: RigModel,
    history: IterationHistory,
    *,
    number: int,
    level: float,
    settings: CampaignSettings,
    controlled: NDArray[np.bool_],
) -> None:
    """Refuse a drive if the identified model predicts that its playback exceeds a bound.

    The prediction is the last response plus the model's response to the change of the drive. Unknown effects of the
    rig (friction, arcs) are in the last response if the step is small. The identified model is used, because a model
    that an update has corrected predicts what that update aims at. With a map the drive is a mapped one.
    """
    if not is_bounded(settings.stop):
        return
    last = history.last
    if last is not None:
        predicted = last.response + predict(model, drive - last.drive, band=settings.update.band)
    else:
        predicted = predict(model, drive, band=settings.update.band)
    passed = passed_bound(judge_response(history.target, predicted, level=level), settings.stop, level=level)
    if passed is not None:
        row = int(np.flatnonzero(controlled)[passed.response])
        raise PlaybackBoundError(number, replace(passed, response=row))
