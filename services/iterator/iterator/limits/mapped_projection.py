"""Limits of a rig with a drive map: drives are projected in topological order."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_drive_map import Adjust, DriveMap
from iterator.band import ControlBand
from iterator.limits.drive_limits import DriveLimitError, DriveLimits, require_within_limits
from iterator.limits.drive_projection import DriveProjection, project_drive

# Factor between tried shares of a step that does not fit, and the smallest share that is stated.
_SMALLER_SHARE: Final = 0.9
_SMALLEST_SHARE: Final = 0.01


def project_mapped_drive(
    mapped: ArrayLike,
    *,
    drive_map: DriveMap,
    limits: DriveLimits,
    band: ControlBand,
    adjust: Adjust | None = None,
) -> DriveProjection:
    """Return the drive of a mapped drive, each channel projected to its limits before its followers are made.

    A drive that follows a product then follows the played drives: if all drives were made before the projection, it
    would follow a stroke that is not played, and the rig would respond with the forces that the map avoids.

    `mapped`, shape (n_u, samples): `v`, drive units. `drive_map`: `T`. `limits`: Drive limits of the rig. `band`: Band
    of the changes, see `project_drive`. `adjust`: Called with each unprojected drive, see `DriveMap.to_drive`.
    Returns: The drive `u`, and every limit that it would have exceeded; `change` and `clipped` are relative to the
    drive before its own projection.
    Raises `ValueError`: The map is for other drives than the limits, a drive may not rest at 0, or a record does not
    fit.
    """
    drive_map.require_drives(limits.names, limits.units, sample_rate=limits.sample_rate)
    require_rest_within_limits(drive_map, limits)
    single: dict[int, DriveProjection] = {}

    def project(i: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        wanted = samples if adjust is None else adjust(i, samples)
        single[i] = project_drive(wanted[None, :], limits=_of_channel(limits, i), band=band)
        return single[i].drive[0]

    drive = drive_map.to_drive(mapped, adjust=project)
    rows = [single[i] for i in range(drive.shape[0])]
    return DriveProjection(
        drive=drive,
        passings=tuple(passing for row in rows for passing in row.passings),
        change=np.concatenate([row.change for row in rows]),
        saturated=np.concatenate([row.saturated for row in rows]),
        clipped=np.concatenate([row.clipped for row in rows]),
    )


def wanted_drive(
    mapped: ArrayLike, *, drive_map: DriveMap, limits: DriveLimits, band: ControlBand
) -> NDArray[np.float64]:
    """Return the wanted drive of each channel, before its own limits and after those of the drives it follows.

    `mapped`, shape (n_u, samples): `v`, drive units. `drive_map`: `T`. `limits`: Drive limits of the rig. `band`: Band
    of the changes.
    Returns: Drives in drive units, shape (n_u, samples); may exceed the limits.
    Raises `ValueError`: As in `project_mapped_drive`.
    """
    wanted: dict[int, NDArray[np.float64]] = {}

    def keep(i: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        wanted[i] = samples
        return samples

    projection = project_mapped_drive(mapped, drive_map=drive_map, limits=limits, band=band, adjust=keep)
    return np.stack([wanted[i] for i in range(projection.drive.shape[0])])


def drive_within_limits(
    mapped: NDArray[np.float64],
    *,
    last_mapped: NDArray[np.float64] | None,
    drive_map: DriveMap,
    limits: DriveLimits,
    iteration_gain: NDArray[np.float64],
    adjust: Adjust | None = None,
) -> NDArray[np.float64]:
    """Return the drive of a mapped drive, or refuse it if it exceeds a limit and state the fitting share of the gains.

    `mapped`, shape (n_u, samples): `v`, drive units. `last_mapped`, shape (n_u, samples): Mapped drive that the
    update stepped from; None is zero. `drive_map`: `T`. `limits`: Drive limits of the rig. `iteration_gain`, shape
    (n_y,): Gains of the step. `adjust`: Called with each drive before its followers are made, see `DriveMap.to_drive`.
    Returns: Drive `u` in drive units, shape (n_u, samples).
    Raises `DriveLimitError`: A value or a slew of the drive exceeds its limit. `ValueError`: A record does not fit.
    """
    start = np.zeros_like(mapped) if last_mapped is None else last_mapped
    drive, last_drive = drive_map.to_drive(mapped, adjust=adjust), drive_map.to_drive(start, adjust=adjust)
    refused = _refusal(drive, last_drive, limits, iteration_gain)
    if refused is None:
        return drive
    # The share of the error assumes a drive proportional to the gains. A drive that follows a product is not.
    share = refused.fitting_share
    while share >= _SMALLEST_SHARE:
        tried = drive_map.to_drive(start + share * (mapped - start), adjust=adjust)
        if _refusal(tried, last_drive, limits, iteration_gain) is None:
            break
        share *= _SMALLER_SHARE
    raise DriveLimitError(
        refused.violation,
        fitting_share=share if share >= _SMALLEST_SHARE else 0.0,
        iteration_gain=iteration_gain,
    )


def _refusal(
    drive: NDArray[np.float64],
    last_drive: NDArray[np.float64],
    limits: DriveLimits,
    iteration_gain: NDArray[np.float64],
) -> DriveLimitError | None:
    try:
        require_within_limits(drive, last_drive=last_drive, limits=limits, iteration_gain=iteration_gain)
    except DriveLimitError as refused:
        return refused
    return None


def require_rest_within_limits(drive_map: DriveMap, limits: DriveLimits) -> None:
    """Refuse limits that exclude the rest position of a drive that a map moves.

    `drive_map`: Its drives rest at `u = 0`, because `T(0) = 0`. `limits`: Of the same drives.
    Raises `ValueError`: 0 is outside the limits of a drive that leads or follows in a term.
    """
    for i in sorted({drive for term in drive_map.terms for drive in (term.follower, *term.product)}):
        lowest, highest = float(limits.minimum[i]), float(limits.maximum[i])
        if not lowest <= 0.0 <= highest:
            raise ValueError(
                f"The limits of {limits.names[i]} are {lowest:g} to {highest:g} {limits.units[i]} and the drive map "
                "rests at 0; shift the drive so that its limits hold 0, or play without a map."
            )


def _of_channel(limits: DriveLimits, channel: int) -> DriveLimits:
    row = slice(channel, channel + 1)
    return replace(
        limits,
        names=limits.names[row],
        units=limits.units[row],
        minimum=limits.minimum[row],
        maximum=limits.maximum[row],
        slew_limit=limits.slew_limit[row],
        actuator_speed=None,
    )
