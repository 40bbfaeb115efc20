"""Playbacks that were made: recorded ones, what was made of each, and all of a campaign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map import LearnedDriveMap
from iterator.assessment import Forecast, IterationMetrics, Outcome, PassedBound, Standstill
from iterator.limits import DriveProjection, UnreachableSegment
from iterator.model import RigModel


@dataclass(frozen=True)
class RecordedPlayback:
    """A playback that was made before, and is not to be made again.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        As played.
    response : ndarray, shape (n_y, samples)
        As measured.
    with_drive_map : bool
        Whether the drive was made with the drive map that the campaign iterates with; False for a playback that was
        made before the map was learned. It has no effect without a map.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    with_drive_map: bool = True


@dataclass(frozen=True)
class FirstDrive:
    """A drive that a campaign begins with in place of one that its model makes.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        As long as the target, drive units; its part in the control band counts.
    response : ndarray, shape (n_y, samples), optional
        What it gave for another target, as measured. Both are then scaled by the factor with which the response comes
        nearest to the target, and the model makes what is missing. Without, the drive is played as it is.
    of_this_target : bool
        The response is what the rig gives now, for the target of this campaign: nothing is scaled, and both count as a
        playback before the first one.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64] | None = None
    of_this_target: bool = False


@dataclass(frozen=True)
class KnownBefore:
    """Knowledge of a rig and a target before the first playback.

    Parameters
    ----------
    campaigns : tuple of tuple of RecordedPlayback
        Playbacks of earlier campaigns on the same rig, each from the first to the last: updates that correct the model
        learn from them, too. Of any length.
    first_drive : FirstDrive, optional
        What the first playback is made from; the model alone where not given.
    """

    campaigns: tuple[tuple[RecordedPlayback, ...], ...] = ()
    first_drive: FirstDrive | None = None


NOTHING_KNOWN = KnownBefore()
"""A campaign that starts from its model alone."""


@dataclass(frozen=True)
class Iteration:
    """One playback and what was made of it.

    Parameters
    ----------
    number : int
        From 1.
    drive : ndarray, shape (n_u, samples)
        As played. Updates work on `DriveMap.to_mapped` of it where there is a drive map.
    response : ndarray, shape (n_y, samples)
        As measured.
    response_in_band : ndarray, shape (n_y, samples)
        As judged: divided by the level.
    metrics : IterationMetrics
        In the control band.
    model : RigModel
        What the drive was made with.
    outcome : Outcome or None
        Why this is the last one; None where it continues.
    level : float
        Share of the target that was played for.
    projection : DriveProjection or None
        What was changed in the drive to hold the rig's limits, empty where it fitted; None where drives beyond them
        are refused, and for a recorded playback.
    unreachable : tuple of UnreachableSegment
        Where responses missed the target because a drive was held at its limits.
    stood_still : tuple of Standstill
        Where responses stood still while their target moved; after a controlled one nothing is made of the playback.
    passed_bound : PassedBound or None
        The bound of a playback that a controlled response passed furthest.
    with_drive_map : bool
        Whether the drive was made with a drive map.
    learned : LearnedDriveMap or None
        The drive map that was learned from this playback; later drives are made with it.
    forecast : Forecast or None
        What was predicted of the controlled responses before the playback, and how far it was missed.
    comparable_from : int
        First playback whose figures compare with this one's: judged in the same control band, by the same responses.
    """

    number: int
    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    response_in_band: NDArray[np.float64]
    metrics: IterationMetrics
    model: RigModel
    outcome: Outcome | None
    level: float = 1.0
    projection: DriveProjection | None = None
    unreachable: tuple[UnreachableSegment, ...] = ()
    stood_still: tuple[Standstill, ...] = ()
    passed_bound: PassedBound | None = None
    with_drive_map: bool = False
    learned: LearnedDriveMap[RigModel] | None = None
    forecast: Forecast | None = None
    comparable_from: int = 1


@dataclass(frozen=True)
class CampaignResult:
    """Everything that an iteration made.

    Parameters
    ----------
    target_in_band : ndarray, shape (n_y, samples)
        What the responses were judged against.
    iterations : tuple of Iteration
        From the first to the last.
    outcome : Outcome
        Why it ended.
    best_iteration : int
        Number of the playback with the smallest error over all channels, from 1.
    """

    target_in_band: NDArray[np.float64]
    iterations: tuple[Iteration, ...]
    outcome: Outcome
    best_iteration: int
