"""Records of playbacks: recorded ones, the result of each, and the result of a campaign."""

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
    """A playback that was made before and is not made again.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Drive as played.
    response : ndarray, shape (n_y, samples)
        Response as measured.
    with_drive_map : bool
        Whether the drive was made with the drive map of the campaign; False for a playback before the map was
        learned. It has no effect without a map.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    with_drive_map: bool = True


@dataclass(frozen=True)
class FirstDrive:
    """A first drive of a campaign that replaces the one that its model makes.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Drive as long as the target, drive units; only its part in the control band is used.
    response : ndarray, shape (n_y, samples), optional
        Its measured response for another target. Both are then scaled by the factor with which the response is
        nearest to the target, and the model adds the missing part. If not given, the drive is played unchanged.
    of_this_target : bool
        Whether the response is that of the rig now, for the target of this campaign: then nothing is scaled, and both
        count as a playback before the first one.
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
        Playbacks of earlier campaigns on the same rig, each from the first to the last and of any length: updates
        that correct the model learn from them, too.
    first_drive : FirstDrive, optional
        Base of the first playback's drive; the model alone if not given.
    """

    campaigns: tuple[tuple[RecordedPlayback, ...], ...] = ()
    first_drive: FirstDrive | None = None


NOTHING_KNOWN = KnownBefore()
"""Knowledge of a campaign that starts from its model alone."""


@dataclass(frozen=True)
class Iteration:
    """One playback and its results.

    Parameters
    ----------
    number : int
        Number from 1.
    drive : ndarray, shape (n_u, samples)
        Drive as played. With a drive map, updates use `DriveMap.to_mapped` of it.
    response : ndarray, shape (n_y, samples)
        Response as measured.
    response_in_band : ndarray, shape (n_y, samples)
        Judged response: divided by the level.
    metrics : IterationMetrics
        Figures in the control band.
    model : RigModel
        Model that the drive was made with.
    outcome : Outcome or None
        Reason of the end if this is the last playback; otherwise None.
    level : float
        Share of the target that was played.
    projection : DriveProjection or None
        Changes of the drive for the rig's limits, empty if it fitted; None if drives beyond them are refused, and for
        a recorded playback.
    unreachable : tuple of UnreachableSegment
        Segments in which responses missed the target because a drive was held at its limits.
    stood_still : tuple of Standstill
        Responses that stood still while their target moved; a playback with a controlled one has no further results.
    passed_bound : PassedBound or None
        The bound that a controlled response exceeded by the largest ratio.
    with_drive_map : bool
        Whether the drive was made with a drive map.
    learned : LearnedDriveMap or None
        Drive map learned from this playback, for later drives.
    forecast : Forecast or None
        Forecast of the controlled responses before the playback, and its error.
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
    """Result of a campaign's iteration.

    Parameters
    ----------
    target_in_band : ndarray, shape (n_y, samples)
        Target that the responses were judged against.
    iterations : tuple of Iteration
        Playbacks from the first to the last.
    outcome : Outcome
        Reason of the end.
    best_iteration : int
        Number of the playback with the smallest error over all channels, from 1.
    """

    target_in_band: NDArray[np.float64]
    iterations: tuple[Iteration, ...]
    outcome: Outcome
    best_iteration: int
