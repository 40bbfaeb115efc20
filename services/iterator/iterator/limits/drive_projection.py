"""Projection of a drive beyond a rig's limits to a near one that the rig can play."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import as_record, line_frequencies, rms
from iterator.band import ControlBand, Segment, segments_of
from iterator.limits.drive_limits import DriveLimits, LimitQuantity, drive_slew

# Margin inside a limit of the aim, so that steps with ever smaller progress arrive after a finite number.
_AIM_INSIDE: Final = 0.005
# Steps in the band before the rest is clipped; a projection that converges needs a few dozen.
_LARGEST_STEPS: Final = 150
# Rounding of the last clip, relative to the limit, so that the rig's own computation finds no excess.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class LimitPassing:
    """Excess of a drive over a limit before its projection.

    Parameters
    ----------
    channel, unit : str
        Name of the drive, and unit of the values.
    quantity : LimitQuantity
        Peak or slew.
    limit, largest_excess : float
        Magnitude of the limit on the side with the largest excess, and that excess.
    share_of_time : float
        Share of the time beyond the limit, above 0 to 1.
    segments : tuple of Segment
        Time segments beyond the limit; segments less than half a second apart are joined.
    """

    channel: str
    unit: str
    quantity: LimitQuantity
    limit: float
    largest_excess: float
    share_of_time: float
    segments: tuple[Segment, ...]

    def __str__(self) -> str:
        """Return the excess as one sentence."""
        first = self.segments[0]
        return (
            f"The drive of {self.channel} would have passed its {self.quantity.value} limit of {self.limit:.4g} "
            f"{self.unit} by {self.largest_excess:.3g} {self.unit}, for {100 * self.share_of_time:.2f} % of the time "
            f"in {len(self.segments)} segments, first at {first.start:.2f} to {first.end:.2f} s."
        )


@dataclass(frozen=True)
class DriveProjection:
    """A drive that the rig can play, and the changes that it needed.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Drive within every limit; channels without an excess are exactly the given ones.
    passings : tuple of LimitPassing
        Every exceeded limit of the given drive; empty if it fitted.
    change : ndarray, shape (n_u,)
        RMS of the removed part, over the RMS of the given drive; 0 if it fitted.
    saturated : ndarray of bool, shape (n_u, samples)
        Samples at which the given drive exceeded a limit.
    clipped : ndarray, shape (n_u,)
        RMS of the clipped part of the change, which is not in the control band, over the RMS of the given drive; 0 if
        the change stays in the band.
    """

    drive: NDArray[np.float64]
    passings: tuple[LimitPassing, ...]
    change: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    clipped: NDArray[np.float64]


def project_drive(drive: NDArray[np.float64], *, limits: DriveLimits, band: ControlBand) -> DriveProjection:
    """Project a drive to a near one that holds peak and slew limits exactly, changed in the control band only.

    A clipped drive has corners, which excite frequencies above the band. The excess over the limits is therefore
    removed in the band, in repeated steps, each as far as the excess' own half-space allows; the rest after a number
    of steps is clipped, and reported in `DriveProjection.clipped`.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Drive units, from rest: its first sample counts as a step from 0.
    limits : DriveLimits
        Drive limits of the rig.
    band : ControlBand
        Control band of the drives.

    Returns
    -------
    DriveProjection
        The drive, and every exceeded limit of the given one.

    Raises
    ------
    ValueError
        The drive does not have the rig's channels, or a value is not finite.

    Notes
    -----
    Source: Bauschke, Combettes, Kruk, "Extrapolation algorithm for affine-convex feasibility problems" (2006): the
    affine set is the set of changes within the band, the convex one the set of playable drives.
    """
    given = as_record(drive, name="drive")
    if given.shape[0] != len(limits.names):
        raise ValueError(f"The drive has {given.shape[0]} channels; the rig has {len(limits.names)} drives.")
    saturated = np.zeros(given.shape, dtype=np.bool_)
    passings: list[LimitPassing] = []
    result = given.copy()
    clipped = np.zeros(given.shape[0])
    mask = band.drive_mask(line_frequencies(band.transform_samples(given.shape[1]), band.sample_rate))
    for i in range(given.shape[0]):
        found = _passings(given[i], limits, channel=i)
        passings += [passing for passing, _ in found]
        for _, past in found:
            saturated[i] |= past
        if found:
            reachable = _Playable.of(limits, channel=i, band=band)
            smooth = _taken_away_in_band(given[i], reachable, mask)
            result[i] = reachable.clip(smooth)
            clipped[i] = _rms(result[i] - smooth)
    level = rms(given)
    level[level == 0.0] = 1.0
    return DriveProjection(
        drive=result,
        passings=tuple(passings),
        change=rms(result - given) / level,
        saturated=saturated,
        clipped=clipped / level,
    )


@dataclass(frozen=True)
class _Playable:
    """Playable range of one drive channel: values and steps between samples, the first one from 0."""

    minimum: float
    maximum: float
    slew_limit: float
    sample_rate: float
    step_weight: float

    @classmethod
    def of(cls, limits: DriveLimits, *, channel: int, band: ControlBand) -> _Playable:
        stated = float(limits.slew_limit[channel])
        return cls(
            minimum=float(limits.minimum[channel]),
            maximum=float(limits.maximum[channel]),
            slew_limit=stated if stated > 0.0 else np.inf,
            sample_rate=limits.sample_rate,
            # A step at the band's upper edge counts as much as the value that it comes from.
            step_weight=(limits.sample_rate / (2.0 * np.pi * band.highest)) ** 2,
        )

    @property
    def step(self) -> float:
        """Largest difference between two samples."""
        return self.slew_limit / self.sample_rate

    def holds(self, values: NDArray[np.float64]) -> bool:
        """Return whether every value and step is allowed."""
        rate = np.abs(drive_slew(values, self.sample_rate))
        return bool(values.min() >= self.minimum and values.max() <= self.maximum and rate.max() <= self.slew_limit)

    def excess(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return gradient and value of the squared distance from a playable drive, aimed a little inside."""
        inside = 1.0 - _AIM_INSIDE
        beyond = values - np.clip(values, inside * self.minimum, inside * self.maximum)
        size = float(beyond @ beyond)
        if np.isfinite(self.step):
            steps = np.diff(values, prepend=0.0)
            too_fast = steps - np.clip(steps, -inside * self.step, inside * self.step)
            beyond += self.step_weight * (too_fast - np.append(too_fast[1:], 0.0))
            size += self.step_weight * float(too_fast @ too_fast)
        return beyond, size

    def clip(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Clip to the nearest values, then to the mean of the lowest and the highest curve of the allowed slew."""
        if self.holds(values):
            return values
        clipped = np.clip(values, self.minimum, self.maximum)
        if not np.isfinite(self.step):
            return clipped
        # The sums below round to the last bits of the values, which may be large beside a step.
        rounding = 8.0 * np.finfo(float).eps * float(np.abs(clipped).max())
        step = max(0.0, (1.0 - _ROUNDING) * self.step - rounding)
        ramp = np.arange(1, values.size + 1, dtype=np.float64) * step
        clipped = np.clip(clipped, -ramp, ramp)
        below = np.minimum(_least_above(clipped, ramp), _least_above(clipped[::-1], ramp)[::-1])
        above = np.maximum(-_least_above(-clipped, ramp), -_least_above(-clipped[::-1], ramp)[::-1])
        return np.clip(0.5 * (below + above), self.minimum, self.maximum)


def _least_above(values: NDArray[np.float64], ramp: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return at each sample the lowest of the ramps that rise from the values up to it."""
    return np.minimum.accumulate(values - ramp) + ramp


def _taken_away_in_band(
    values: NDArray[np.float64], playable: _Playable, mask: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Approach the playable set by changes in the band only, until it is reached or the steps are used."""
    length = 2 * (mask.size - 1)
    current = values
    for _ in range(_LARGEST_STEPS):
        if playable.holds(current):
            break
        gradient, size = playable.excess(current)
        in_band = np.fft.irfft(np.fft.rfft(gradient, length) * mask, length)[: values.size]
        slope = float(gradient @ in_band)
        if slope <= np.finfo(float).eps * size:
            break
        current = current - size / slope * in_band
    return current


def _passings(
    values: NDArray[np.float64], limits: DriveLimits, *, channel: int
) -> list[tuple[LimitPassing, NDArray[np.bool_]]]:
    """Return every exceeded limit of one drive, with a mask of its samples."""
    unit, slew_limit = limits.units[channel], float(limits.slew_limit[channel])
    found: list[tuple[LimitPassing, NDArray[np.bool_]]] = []
    sides = [(LimitQuantity.PEAK, unit, values, float(limits.minimum[channel]), float(limits.maximum[channel]))]
    if slew_limit > 0.0:
        sides.append((LimitQuantity.SLEW, f"{unit}/s", drive_slew(values, limits.sample_rate), -slew_limit, slew_limit))
    for quantity, quantity_unit, signal, lowest, highest in sides:
        excess = np.maximum(signal - highest, lowest - signal)
        past = excess > 0.0
        if past.any():
            worst = int(np.argmax(excess))
            passing = LimitPassing(
                channel=limits.names[channel],
                unit=quantity_unit,
                quantity=quantity,
                limit=abs(highest if signal[worst] > highest else lowest),
                largest_excess=float(excess[worst]),
                share_of_time=float(past.mean()),
                segments=segments_of(past, sample_rate=limits.sample_rate),
            )
            found.append((passing, past))
    return found


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
