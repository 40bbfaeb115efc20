"""A rig's limits, checked before a drive is played."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Share of the range between the limits: a drive projected to a limit within a band stays just below it.
_HELD_WITHIN: Final = 0.01


class LimitQuantity(enum.Enum):
    """Limited quantity of a drive."""

    PEAK = "peak"
    SLEW = "slew"


@dataclass(frozen=True)
class DriveLimits:
    """Limits of each drive channel of a rig.

    Parameters
    ----------
    names, units : tuple of str
        Name and unit of each drive.
    minimum, maximum : ndarray, shape (n_u,)
        Allowed values, drive units, `minimum < 0 < maximum`.
    slew_limit : ndarray, shape (n_u,)
        Largest allowed magnitude of the time derivative, drive units per second; 0 if not stated.
    sample_rate : float
        Sample rate of the drives, Hz.
    actuator_speed : ndarray, shape (n_u,), optional
        Speed of each actuator with its valve at its stop, drive units per second; 0 if not stated. A drive may ask for
        more.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    minimum: NDArray[np.float64]
    maximum: NDArray[np.float64]
    slew_limit: NDArray[np.float64]
    sample_rate: float
    actuator_speed: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class LimitViolation:
    """Largest excess of one drive over a limit.

    Parameters
    ----------
    channel, unit : str
        Name of the drive and unit of the two values.
    quantity : LimitQuantity
        Peak or slew.
    value, limit : float
        Value that the drive would reach, and allowed value.
    """

    channel: str
    unit: str
    quantity: LimitQuantity
    value: float
    limit: float


class DriveLimitError(ValueError):
    """Refusal of a next drive that exceeds the rig's limits.

    Parameters
    ----------
    violation : LimitViolation
        Violation with the largest ratio to its limit.
    fitting_share : float
        Share of all iteration gains with which the drive would fit, 0 to below 1.
    iteration_gain : ndarray, shape (n_y,)
        Gains of the step.
    """

    def __init__(self, violation: LimitViolation, *, fitting_share: float, iteration_gain: NDArray[np.float64]) -> None:
        self.violation = violation
        self.fitting_share = fitting_share
        self.fitting_gain = fitting_share * iteration_gain
        largest = float(np.max(self.fitting_gain))
        advice = (
            f"it would fit with all iteration gains at about {_floor(fitting_share):g} of theirs, the largest then "
            f"{_floor(largest):g}"
            if _floor(fitting_share) > 0.0
            else "no smaller iteration gain would fit, the last drive is at the limit already: ask for a smaller target"
        )
        super().__init__(
            f"The next drive of {violation.channel} would reach a {violation.quantity.value} of {violation.value:.4g} "
            f"{violation.unit}, past the rig's limit of {violation.limit:.4g} {violation.unit}; {advice}."
        )


class DriveOverrunError(ValueError):
    """Refusal of a first drive that exceeds a limit by so much that it is not projected.

    Parameters
    ----------
    violation : LimitViolation
        Violation with the largest ratio to its limit.
    allowed : float
        Multiple of the limit up to which a drive is projected.
    """

    def __init__(self, violation: LimitViolation, *, allowed: float) -> None:
        self.violation = violation
        super().__init__(
            f"The target asks {violation.channel} for a {violation.quantity.value} of {abs(violation.value):.3g} "
            f"{violation.unit}, {abs(violation.value / violation.limit):.3g} times the rig's limit of "
            f"{abs(violation.limit):.3g} {violation.unit}; a first drive of at most {allowed:g} times a limit "
            "(largest_overrun) is projected: look at the target's units, scales, signs and channels, or scale it down."
        )


def require_small_overrun(drive: NDArray[np.float64], *, limits: DriveLimits, allowed: float) -> None:
    """Refuse a first drive that exceeds a multiple of a limit.

    `drive`, shape (n_u, samples): For the whole target, not projected. `limits`: Drive limits of the rig. `allowed`:
    Multiple of each limit, 1 or more.
    Raises `DriveOverrunError`: A value or a slew is beyond the multiple.
    """
    worst = max(
        (
            LimitViolation(channel=name, unit=unit, quantity=quantity, value=value, limit=limit)
            for quantity, name, unit, values, lowest, highest in _limited(drive, limits)
            for value, limit in ((float(values.max()), highest), (float(values.min()), lowest))
        ),
        key=lambda found: found.value / found.limit,
    )
    if worst.value > allowed * worst.limit if worst.limit > 0.0 else worst.value < allowed * worst.limit:
        raise DriveOverrunError(worst, allowed=allowed)


def _limited(
    drive: NDArray[np.float64], limits: DriveLimits
) -> Iterator[tuple[LimitQuantity, str, str, NDArray[np.float64], float, float]]:
    """Yield the limited quantities of each drive: quantity, channel, unit, values, smallest and largest value."""
    if drive.shape[0] != len(limits.names):
        raise ValueError(f"The drive has {drive.shape[0]} channels; the rig has {len(limits.names)} drives.")
    for i, (name, unit) in enumerate(zip(limits.names, limits.units, strict=True)):
        yield LimitQuantity.PEAK, name, unit, drive[i], float(limits.minimum[i]), float(limits.maximum[i])
        slew_limit = float(limits.slew_limit[i])
        if slew_limit > 0.0:
            slew = drive_slew(drive[i], limits.sample_rate)
            yield LimitQuantity.SLEW, name, f"{unit}/s", slew, -slew_limit, slew_limit


def require_within_limits(
    drive: NDArray[np.float64],
    *,
    last_drive: NDArray[np.float64] | None,
    limits: DriveLimits,
    iteration_gain: NDArray[np.float64],
) -> None:
    """Refuse a drive that exceeds a limit, and state the share of the gains that would fit.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        The next drive.
    last_drive : ndarray, shape (n_u, samples), or None
        Drive that the update stepped from, the best so far or the one before; None is `U_0 = 0`.
    limits : DriveLimits
        Drive limits of the rig.
    iteration_gain : ndarray, shape (n_y,)
        Gains of the step; it is proportional to them, except where squares of the drives are compensated.

    Raises
    ------
    DriveLimitError
        A value or a slew of the drive exceeds its limit.
    ValueError
        The drive does not have the rig's channels.
    """
    start = np.zeros_like(drive) if last_drive is None else last_drive
    violations: list[LimitViolation] = []
    share = 1.0
    for (quantity, name, unit, values, lowest, highest), before in zip(
        _limited(drive, limits), _limited(start, limits), strict=True
    ):
        worst = _worst(values, lowest=lowest, highest=highest)
        if worst is not None:
            violations.append(
                LimitViolation(channel=name, unit=unit, quantity=quantity, value=worst[0], limit=worst[1])
            )
            share = min(share, _fitting_share(values, before[3], lowest=lowest, highest=highest))
    if violations:
        worst_of_all = max(violations, key=lambda found: abs(found.value) / max(abs(found.limit), np.finfo(float).tiny))
        raise DriveLimitError(worst_of_all, fitting_share=share, iteration_gain=iteration_gain)


def drive_slew(values: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """Return the rate of change of one drive."""
    # From rest, all drives zero: a rig's description does not state whether it ramps to the first sample, and a rig
    # without a ramp begins with a step.
    return np.diff(values, prepend=0.0) * sample_rate


def _worst(values: NDArray[np.float64], *, lowest: float, highest: float) -> tuple[float, float] | None:
    """Return the value furthest outside and the limit that it exceeds, or None."""
    if values.size == 0:
        return None
    above, below = float(values.max()), float(values.min())
    if above <= highest and below >= lowest:
        return None
    return (above, highest) if above - highest >= lowest - below else (below, lowest)


def _fitting_share(values: NDArray[np.float64], before: NDArray[np.float64], *, lowest: float, highest: float) -> float:
    step = values - before
    limit = np.where(step > 0.0, highest, lowest)
    room = np.divide(limit - before, step, out=np.full_like(step, np.inf), where=step != 0.0)
    return float(np.clip(room.min(), 0.0, 1.0))


def _floor(value: float) -> float:
    """Round down to two decimals, so that a stated gain fits if the step is proportional to it."""
    return float(np.floor(value * 100.0) / 100.0)


def held_share(drive: NDArray[np.float64], limits: DriveLimits) -> float:
    """Return the share of the time that a drive is at, or within 1 % of the range of, its smallest or largest value.

    `drive`, shape (n_u, samples): As played, drive units. `limits`: Drive limits of the rig.
    Returns: Share of the time in which at least one channel is held, 0 to 1.
    """
    reach = limits.maximum - limits.minimum
    near = np.where(np.isfinite(reach), _HELD_WITHIN * reach, 0.0)[:, None]
    held = (drive >= limits.maximum[:, None] - near) | (drive <= limits.minimum[:, None] + near)
    return float(np.mean(np.any(held, axis=0)))
