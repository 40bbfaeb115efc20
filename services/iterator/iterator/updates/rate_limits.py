"""Rate limits of the actuators, stated by the rig or learned from what the responses lack; a step is held within them.

A drive that asks for more than an actuator gives has no effect there, and an update with an FRF alone asks for more
with each playback. A step within the limit begins the motion earlier instead. It is held only where errors are large.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator.band import ControlBand, LowerRate
from iterator.limits import DriveLimits
from iterator.model import (
    InterpolatedMatrix,
    IterationHistory,
    Playback,
    RateLimit,
    RigModel,
    equivalent_drive,
    gram_and_ridge,
)
from iterator.updates.basic_twr import StepStart
from iterator.updates.settings import UpdateSettings

RateLimits = tuple[RateLimit | None, ...]
"""Limit of each drive, as far as it is known."""

# Error, as a share of the target's RMS, above which a stretch may be limited, and the time over which it is averaged,
# s. After two playbacks most of an error still falls without a limit.
_LARGE_ERROR: Final = 0.2
_LARGE_AFTER_TWO: Final = 0.5
_ERROR_SECONDS: Final = 0.25
# Share of the time with such errors above which they are not those of a limit: it is reached in short stretches.
_MOST_OF_TIME: Final = 0.25
# Number of last steps in which limits are looked for.
_STEPS: Final = 3
# Corner frequency of an actuator over the end of the band: the limit that is found hardly depends on it.
_CORNER: Final = 0.9
# Rates that are tried: from the first, of the fastest playback, down by the ratio to the last, of the slowest one, and
# never below the least, of the fastest.
_FIRST_RATE, _LAST_RATE, _LEAST_RATE, _RATIO = 0.95, 0.3, 0.1, 1.12
# A limit is found if its prediction correlates with what the responses lack, and if it is about as large.
_CORRELATION: Final = 0.25
_SMALLEST_SHARE, _LARGEST_SHARE = 0.6, 2.5
# Time around the prediction in which they are compared, s, and the share of its largest energy that belongs to it.
_AROUND_SECONDS: Final = 0.05
_BELONGS: Final = 1e-3
# Share of the largest speed of a drive where the error is not large, below which it has no limit: it is followed there.
_FOLLOWED: Final = 0.9
# Number of corrections to a drive in the band, so that an actuator with a limit moves as is wanted.
_CORRECTIONS: Final = 5
# Rounds of alternating directions, and the weight of the limits in them, relative to the response.
_ROUNDS: Final = 60
_WEIGHT: Final = 10.0
# Sample rate, over twice the end of the band, at which actuators are computed.
_OVERSAMPLING: Final = 4.0


@dataclass(frozen=True)
class FittedRig:
    """Rig as the secant update fitted it, with the scales of the fit.

    `model`: With the limits known before. `lines`: Fitted lines of the model. `uncertainty`, shape (lines, n_u, n_u):
    Of weighted responses to scaled drives. `regularisation`: Of the inverse.
    """

    model: RigModel
    lines: NDArray[np.intp]
    uncertainty: NDArray[np.complex128]
    regularisation: float
    response_weight: NDArray[np.float64]
    drive_scale: NDArray[np.float64]
    band: ControlBand

    @property
    def known(self) -> RateLimits:
        """Limits known before; None where none is."""
        return self.model.rate_limits or (None,) * self.drive_scale.size

    def scaled(self, samples: int) -> _ScaledRig:
        """Return the rig at the lines of a record."""
        return _ScaledRig(
            self.model.frf[self.lines] * self.response_weight[:, None] * self.drive_scale,
            frequency=self.model.frequency[self.lines],
            response_weight=self.response_weight,
            drive_scale=self.drive_scale,
            samples=samples,
            band=self.band,
        )


def stated_rate_limits(
    limits: DriveLimits | None, update: UpdateSettings, *, followers: Collection[int] = (), level: float = 1.0
) -> RateLimits:
    """Return the rate limits of drives that are divided by their level; empty if the rig states none.

    `limits`: With the speeds of the actuators. `update`: Settings that may switch rate limits off. `followers`: Drives
    that follow others in a drive map; an actuator does not move with its mapped drive there.
    """
    if limits is None or limits.actuator_speed is None or not update.secant.rate_limits:
        return ()
    stated = tuple(
        RateLimit(_CORNER * update.band.highest, speed / level) if speed > 0.0 and drive not in followers else None
        for drive, speed in enumerate(limits.actuator_speed.tolist())
    )
    return stated if any(stated) else ()


def large_errors(history: IterationHistory, fitted: FittedRig, *, start: StepStart) -> NDArray[np.bool_]:
    """Return where the error at the start of a step is large, shape (samples,); nowhere if nearly every one is."""
    weight, band = fitted.response_weight, fitted.band
    error = np.sum((weight[:, None] * (history.target - start.response)) ** 2, axis=0)
    allowed = _LARGE_ERROR if len(history.playbacks) > 2 else _LARGE_AFTER_TWO
    large = _averaged(error, band.sample_rate) > np.sum((allowed * weight * rms(history.target)) ** 2)
    return large if np.mean(large) < _MOST_OF_TIME else np.zeros_like(large)


def find_rate_limits(
    history: IterationHistory, fitted: FittedRig, *, start: StepStart, large: NDArray[np.bool_]
) -> RateLimits:
    """Look for the rate limits that explain what the last steps lack where the error is large.

    `history`: With the drives that were played. `start`: Of the step. `large`, shape (samples,): Where the error is
    large.
    Returns: Limits that the rig states, if there are any. Otherwise the limit of each drive; where none is found, the
    one known before, if no drive that is followed exceeds it.
    """
    if fitted.model.stated_rate_limits:
        return fitted.model.stated_rate_limits
    if not large.any():
        return fitted.known
    rig = fitted.scaled(history.target.shape[1])
    speed = RateLimit(rig.corner, 1.0).motion(rig.frequency)
    speeds = np.abs(rig.lower.in_time(speed * rig.lines(start.drive / rig.drive_scale[:, None])))
    followed = _FOLLOWED * speeds[:, rig.lower.mask(~large)].max(axis=1)
    known = [
        limit if limit is not None and limit.rate >= least else None
        for limit, least in zip(fitted.known, followed * rig.drive_scale, strict=True)
    ]
    return _found(rig, history, known, where=rig.lower.mask(large), followed=followed)


def drive_within_rate_limits(
    drive: NDArray[np.float64],
    limits: RateLimits,
    fitted: FittedRig,
    *,
    moved_from: NDArray[np.float64],
    played: StepStart,
    large: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return a drive with which actuators that have limits move nearly as with `drive` without limits.

    First `drive` is changed so that it asks no actuator for more than its limit where the error is large; then the
    drive in the band is sought that moves them so. `fitted`: To drives that move actuators without limits as those
    played did with limits; `moved_from` is the one at the start of the step, and `drive` at its end. `played`: Start of
    the step, with the drive that was played. `large`, shape (samples,): Where the error is large.
    """
    band = fitted.band
    wanted = equivalent_drive(
        _held(drive, limits, fitted, moved_from=moved_from, large=large),
        limits,
        sample_rate=band.sample_rate,
        where=large,
    )
    made = played.drive + band.limit_drive(wanted - moved_from)
    for _ in range(_CORRECTIONS):
        moved = equivalent_drive(made, limits, sample_rate=band.sample_rate, where=large)
        # Where the last step was worse, the next one keeps more of what was played.
        made = made + band.limit_drive(played.share * (wanted - moved))
    return made


def _averaged(energy: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """Return the mean around each sample; there is no energy before the first and after the last."""
    half = max(1, round(0.5 * _ERROR_SECONDS * sample_rate))
    total = np.concatenate(([0.0], np.cumsum(energy)))
    at = np.arange(energy.size)
    first, end = np.maximum(at - half, 0), np.minimum(at + half + 1, energy.size)
    return np.asarray((total[end] - total[first]) / (2 * half + 1), dtype=np.float64)


class _ScaledRig:
    """Fitted rig at the lines of the band, drives over their scale and responses times their weight.

    `frf`, shape (known lines, n_y, n_u), and `frequency`, Hz: At the lines of the fit.
    """

    def __init__(
        self,
        frf: NDArray[np.complex128],
        *,
        frequency: NDArray[np.float64],
        response_weight: NDArray[np.float64],
        drive_scale: NDArray[np.float64],
        samples: int,
        band: ControlBand,
    ) -> None:
        self.frf, self.known, self.response_weight, self.drive_scale = frf, frequency, response_weight, drive_scale
        self.transform = band.transform(samples)
        self.frequency = self.transform.frequency
        self.at = np.clip(self.frequency, frequency[0], frequency[-1])
        self.mask = band.drive_mask(self.frequency)
        self.corner = _CORNER * band.highest
        self.lower = LowerRate(self.transform, oversampling=_OVERSAMPLING)
        self.sample_rate = band.sample_rate * self.lower.share
        self.response = self._interpolated(frf)
        self.adjoint = self._interpolated(frf.conj().transpose(0, 2, 1))
        power = np.sum(np.abs(frf) ** 2, axis=1)[:, :, None].astype(np.complex128)
        self.power = self._interpolated(power).times(np.ones((1, self.frequency.size), dtype=np.complex128)).real
        """Squared gain of each drive to all responses at each line."""

    def _interpolated(self, matrix: NDArray[np.complex128]) -> InterpolatedMatrix:
        return InterpolatedMatrix(self.known, np.ascontiguousarray(matrix), at=self.at)

    def solution(self, matrix: NDArray[np.complex128]) -> InterpolatedMatrix:
        """Return the inverse of a matrix at the known lines."""
        return self._interpolated(np.asarray(np.linalg.inv(matrix), dtype=np.complex128))

    def lines(self, record: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the lines of a record."""
        lines = np.empty((record.shape[0], self.frequency.size), dtype=np.complex128)
        everywhere = np.ones(self.frequency.size)
        for row, out in zip(record, lines, strict=True):
            self.transform.lines(row, weight=everywhere, out=out)
        return lines


@dataclass(frozen=True)
class _Missing:
    """Samples at the lower rate in which a step is less with a limit, and by how much; few of a long record."""

    at: NDArray[np.intp]
    values: NDArray[np.float64]

    @classmethod
    def of(cls, step: NDArray[np.float64]) -> _Missing:
        """Keep the samples of a step that are not 0."""
        at = np.flatnonzero(step)
        return cls(at, step[at])

    def lines(self, rig: _ScaledRig) -> NDArray[np.complex128]:
        """Return them as lines."""
        samples = np.zeros((1, rig.lower.samples))
        samples[0, self.at] = self.values
        return np.asarray(rig.lower.in_lines(samples)[0] * rig.mask, dtype=np.complex128)


@dataclass(frozen=True)
class _Tried:
    """A limit of one drive, in scaled units, and by how much the drive of each step is less with it."""

    limit: RateLimit
    missing: tuple[_Missing, ...]


def _found(
    rig: _ScaledRig,
    history: IterationHistory,
    known: Sequence[RateLimit | None],
    *,
    where: NDArray[np.bool_],
    followed: NDArray[np.float64],
) -> RateLimits:
    """Return the limits that explain what the last steps lack; where none is found, the one known before.

    The drive whose limit explains most is first, and what it explains is no longer lacking for the others.
    """
    playbacks = history.playbacks[-_STEPS - 1 :]
    from_rest = len(playbacks) == len(history.playbacks)
    steps = _LastSteps(rig, playbacks, from_rest=from_rest, where=where, followed=followed)
    limits = list(known)
    best = {drive: steps.best(drive) for drive in range(rig.drive_scale.size)}
    while best:
        drive = max(best, key=lambda each: best[each][0])
        gain, tried = best.pop(drive)
        if gain <= 0.0 or tried is None:
            break
        if steps.explained(drive, tried):
            limits[drive] = RateLimit(tried.limit.corner, tried.limit.rate * float(rig.drive_scale[drive]))
            best = {each: steps.best(each) for each in best}
    return tuple(limits)


class _LastSteps:
    """What the fitted rig leaves unexplained of the last steps, and what limits would explain of it."""

    def __init__(
        self,
        rig: _ScaledRig,
        playbacks: Sequence[Playback],
        *,
        from_rest: bool,
        where: NDArray[np.bool_],
        followed: NDArray[np.float64],
    ) -> None:
        self._rig = rig
        drives = [rig.lines(each.drive / rig.drive_scale[:, None]) for each in playbacks]
        responses = [rig.lines(each.response * rig.response_weight[:, None]) for each in playbacks]
        if from_rest:
            drives.insert(0, np.zeros_like(drives[0]))
            responses.insert(0, np.zeros_like(responses[0]))
        self._lacking = [
            (response - response_before) - rig.response.times(drive - drive_before)
            for drive, drive_before, response, response_before in zip(
                drives[1:], drives, responses[1:], responses, strict=False
            )
        ]
        self._by_drive = [rig.adjoint.times(each) for each in self._lacking]
        self._tried = [
            _limits_to_try(rig, [each[drive] for each in drives], where, least=float(least))
            for drive, least in enumerate(followed)
        ]

    def best(self, drive: int) -> tuple[float, _Tried | None]:
        """Return the limit of a drive that explains most of the lacking energy, and how much; at least 0."""
        most, best = 0.0, None
        for tried in self._tried[drive]:
            explained = 0.0
            for missing, lacking in zip(tried.missing, self._by_drive, strict=True):
                if missing.at.size:
                    lines = missing.lines(self._rig)
                    explained += 2.0 * float(np.vdot(lines, lacking[drive]).real)
                    explained -= float(np.sum(np.abs(lines) ** 2 * self._rig.power[drive]))
            if explained > most:
                most, best = explained, tried
        return most, best

    def explained(self, drive: int, tried: _Tried) -> bool:
        """Return whether a limit predicts what is lacking around it; if so, that is no longer lacking."""
        rig = self._rig
        width = 2 * round(0.5 * _AROUND_SECONDS * rig.sample_rate) + 1
        predicted: dict[int, NDArray[np.complex128]] = {}
        common = own = lacking = 0.0
        for number, missing in enumerate(tried.missing):
            if not missing.at.size:
                continue
            of_drives = np.zeros((rig.drive_scale.size, rig.frequency.size), dtype=np.complex128)
            of_drives[drive] = missing.lines(rig)
            predicted[number] = rig.response.times(of_drives)
            in_time, lacks = rig.lower.in_time(predicted[number]), rig.lower.in_time(self._lacking[number])
            around = np.convolve(np.sum(in_time**2, axis=0), np.ones(width), "same")
            common += float(np.sum(in_time * lacks))
            own += float(np.sum(in_time**2))
            lacking += float(np.sum(lacks[:, around > _BELONGS * around.max()] ** 2))
        if common <= _CORRELATION * np.sqrt(own * lacking) or not _SMALLEST_SHARE < common / own < _LARGEST_SHARE:
            return False
        for number, each in predicted.items():
            self._lacking[number] = self._lacking[number] - each
            self._by_drive[number] = rig.adjoint.times(self._lacking[number])
        return True


def _limits_to_try(
    rig: _ScaledRig, drive: Sequence[NDArray[np.complex128]], where: NDArray[np.bool_], *, least: float
) -> list[_Tried]:
    """Return limits of one drive, given as lines of each playback, from the largest."""
    # The rates of all playbacks where limits are looked for.
    asked = RateLimit(rig.corner, 1.0).motion(rig.frequency)
    rates = np.abs(rig.lower.in_time(asked * np.stack(drive))[:, where]).max(axis=1)
    largest, smallest = float(rates.max()), float(rates[rates > 0.0].min(initial=np.inf))
    in_time = rig.lower.in_time(np.stack(drive))
    tried: list[_Tried] = []
    rate = _FIRST_RATE * largest
    while rate > max(_LAST_RATE * smallest, _LEAST_RATE * largest, least):
        limit = RateLimit(rig.corner, rate)
        held_back = [limit.held_back(each, sample_rate=rig.sample_rate, where=where) for each in in_time]
        steps = zip(held_back[1:], held_back, strict=False)
        tried.append(_Tried(limit, tuple(_Missing.of(after - before) for after, before in steps)))
        rate /= _RATIO
    return tried


def _held(
    drive: NDArray[np.float64],
    limits: RateLimits,
    fitted: FittedRig,
    *,
    moved_from: NDArray[np.float64],
    large: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the drive with nearly the same predicted response that asks no actuator for more than its limit.

    Only drives with a limit are changed. Least squares of the change of the predicted response and of its uncertainty,
    by the alternating direction method of multipliers: a limit bounds a filtered drive, so that each round is solved
    line by line.

    Source: S. Boyd et al., *Distributed optimization and statistical learning via the alternating direction method of
    multipliers* (2011).
    """
    rig = fitted.scaled(drive.shape[1])
    where = rig.lower.mask(large)
    limited = np.flatnonzero([limit is not None for limit in limits])
    speeds, known_speeds = (
        rig.drive_scale[limited, None] * np.stack([limit.motion(frequency) for limit in limits if limit is not None])
        for frequency in (rig.frequency, rig.known)
    )
    asked, before = (
        rig.lower.in_time(speeds * rig.lines(record[limited] / rig.drive_scale[limited, None]))
        for record in (drive, moved_from)
    )
    # The motion at the start holds the limits, but not the part of it that is in the band: as much is allowed.
    most = np.where(where, np.maximum(np.abs(before), 1.0), np.inf)
    if np.all(np.abs(asked) <= most):
        return drive
    gram, ridge = gram_and_ridge(rig.frf, regularisation=fitted.regularisation)
    n_u = rig.drive_scale.size
    cost = (gram + fitted.uncertainty[:, :n_u, :n_u] + ridge)[:, limited[:, None], limited]
    squared = np.abs(known_speeds.T) ** 2
    weight = _WEIGHT * float(np.mean(np.einsum("fii->fi", gram).real)) / float(np.mean(squared, axis=0).max())
    own = np.arange(limited.size)
    cost[:, own, own] += weight * squared
    solution = rig.solution(cost)
    allowed, price = np.clip(asked, -most, most), np.zeros_like(asked)
    change = np.zeros((limited.size, rig.frequency.size), dtype=np.complex128)
    for _ in range(_ROUNDS):
        change = -solution.times(weight * speeds.conj() * rig.lower.in_lines(asked - allowed + price)) * rig.mask
        reached = asked + rig.lower.in_time(speeds * change)
        allowed = np.clip(reached + price, -most, most)
        price += reached - allowed
    held = drive.copy()
    moved = np.empty(drive.shape[1])
    for number, lines in zip(limited, change, strict=True):
        rig.transform.samples(lines, out=moved)
        held[number] += rig.drive_scale[number] * moved
    return held
