"""Segment acceptance: a segment that became worse than the best so far is restored, and its next step is smaller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_spectra.transforms import backward, fast_length, forward
from iterator.model import IterationHistory


@dataclass(frozen=True)
class AcceptanceSettings:
    """Settings of the acceptance of a playback, segment by segment.

    Parameters
    ----------
    judged_seconds : float
        Width of the Hann window over which the error's energy is averaged, s, greater than 0.
    cross_fade_seconds : float
        Width of the Hann window that blends from one drive to another, s, greater than 0.
    tolerance : float
        A segment is worse if its energy exceeds this multiple of the best so far, 1 or more.
    smaller_step, larger_step : float
        Factors of the step gain for a worse segment, in (0, 1), and for any other, 1 or more; the square root of the
        latter after one time worse, and so on.
    smallest_step : float
        Smallest step gain, in (0, 1].
    least_progress : float
        Share of the predicted progress of a step below which the next one is smaller, 0 to below 1; 0 uses
        `tolerance` alone.
    doubted_step : float
        Factor of the step gain in that case, in (0, 1].
    negligible : float
        Share of the target's mean energy below which a difference in energy is rounding, 0 to below 1.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    judged_seconds: float = 2.0
    cross_fade_seconds: float = 0.5
    tolerance: float = 1.03
    smaller_step: float = 0.5
    larger_step: float = 1.25
    smallest_step: float = 0.1
    least_progress: float = 0.4
    doubted_step: float = 0.9
    negligible: float = 1e-10

    def __post_init__(self) -> None:
        for name in ("judged_seconds", "cross_fade_seconds"):
            seconds = getattr(self, name)
            if not 0.0 < seconds < np.inf:
                raise ValueError(f"The acceptance's {name} is {seconds:g} s; it must be finite and greater than 0.")
        if not (1.0 <= self.tolerance < np.inf and 1.0 <= self.larger_step < np.inf):
            raise ValueError(
                f"The acceptance's tolerance is {self.tolerance:g} and its larger step {self.larger_step:g}; both must "
                "be finite and 1 or more."
            )
        if not (0.0 < self.smaller_step < 1.0 and 0.0 < self.smallest_step <= 1.0):
            raise ValueError(
                f"The acceptance's smaller step is {self.smaller_step:g}, in (0, 1), and its smallest "
                f"{self.smallest_step:g}, in (0, 1]."
            )
        if not (0.0 <= self.least_progress < 1.0 and 0.0 < self.doubted_step <= 1.0):
            raise ValueError(
                f"The acceptance's least progress is {self.least_progress:g}, in [0, 1), and its doubted step "
                f"{self.doubted_step:g}, in (0, 1]."
            )
        if not 0.0 <= self.negligible < 1.0:
            raise ValueError(f"The negligible share of energy is {self.negligible:g}; it must be 0 or more, below 1.")


@dataclass(frozen=True)
class AcceptedIterate:
    """Start of the next step.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        Best drive so far, segment by segment.
    response : ndarray, shape (n_y, samples)
        Response of that drive.
    step_gain : ndarray, shape (samples,)
        Share of a step that is made at each instant, above 0 and at most 1.
    rolled_back : ndarray of bool, shape (samples,)
        Samples at which the last playback was worse and its drive was dropped.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    step_gain: NDArray[np.float64]
    rolled_back: NDArray[np.bool_]


def accept_segments(
    history: IterationHistory,
    *,
    response_scale: NDArray[np.float64],
    sample_rate: float,
    settings: AcceptanceSettings,
    iteration_gain: Sequence[float] = (),
) -> AcceptedIterate:
    """Compose the best drive so far from all playbacks, segment by segment.

    A step with the gain `g` is predicted to leave `(1 - g)²` of the error's energy. In segments worse than the best so
    far, drive and error are restored and the next step is halved. If the progress was far less than predicted, the
    drive stays and the next step is a little smaller, because of an effect that the model does not include.

    Parameters
    ----------
    history : IterationHistory
        History with one playback or more; all are processed again, so the result depends on nothing else.
    response_scale : ndarray, shape (n_y,)
        Factor of each response's error before channels are added: one over its target's RMS; 0 for a monitored
        response.
    sample_rate : float
        Sample rate of all records, Hz.
    settings : AcceptanceSettings
        Settings with tolerance, widths and step factors.
    iteration_gain : sequence of float, optional
        Smallest iteration gain of the step to each playback except the first, in (0, 1]; 1 if not given.

    Returns
    -------
    AcceptedIterate
        Start of the next step.

    Raises
    ------
    ValueError
        There is no playback yet, or the number of gains differs from that of steps.

    Notes
    -----
    Source: trust regions, as in J. Nocedal, S. J. Wright, *Numerical Optimization*, for steps with too little progress.
    """
    if not history.playbacks:
        raise ValueError("There is no playback to accept; play the first drive before.")
    steps = len(history.playbacks) - 1
    made_with = tuple(iteration_gain) or (1.0,) * steps
    if len(made_with) != steps:
        raise ValueError(f"There are {len(made_with)} iteration gains for {steps} steps; give one for each, or none.")
    judged = _Smoothing.of(_hann(settings.judged_seconds, sample_rate), samples=history.target.shape[1])
    blend = _hann(settings.cross_fade_seconds, sample_rate)
    rounding = settings.negligible * float(np.mean(_power(history.target, response_scale)))
    best = _local_energy(history.target, history.playbacks[0].response, response_scale, judged)
    gain = np.ones(best.size)
    failures, growth = np.zeros(best.size), np.full(best.size, settings.larger_step)
    worse = np.zeros(best.size, dtype=bool)
    fades: list[NDArray[np.float64] | None] = [None]
    for playback, share in zip(history.playbacks[1:], made_with, strict=True):
        energy = _local_energy(history.target, playback.response, response_scale, judged)
        worse = energy > settings.tolerance * best + rounding
        back = _cross_fade(worse, blend) if worse.any() else None
        fades.append(back)
        if back is not None:
            failed = back > 0.0
            failures[failed] += back[failed]
            # In segments where the step was too large before, it grows half as fast: it would be too large repeatedly.
            growth[failed] = settings.larger_step ** (0.5 ** failures[failed])
        promised = (1.0 - np.square(1.0 - share * gain)) * best
        doubted = ~worse & (best - energy < settings.least_progress * promised - rounding)
        larger = np.minimum(1.0, growth * gain)
        if doubted.any():
            careful = np.maximum(settings.smallest_step, settings.doubted_step * gain)
            larger += _cross_fade(doubted, blend) * (careful - larger)
        smaller = np.maximum(settings.smallest_step, settings.smaller_step * gain)
        gain = larger if back is None else larger + back * (smaller - larger)
        best = np.where(worse, best, np.minimum(best, energy))
    shares = _shares(fades, best.size)
    return AcceptedIterate(
        drive=_composed([playback.drive for playback in history.playbacks], shares),
        response=_composed([playback.response for playback in history.playbacks], shares),
        step_gain=gain,
        rolled_back=worse,
    )


def _hann(seconds: float, sample_rate: float) -> NDArray[np.float64]:
    """Return a Hann window of odd length and sum 1, without its zeros at the ends."""
    half = max(1, round(seconds * sample_rate / 2.0))
    window = np.hanning(2 * half + 1)[1:-1]
    return window / window.sum()


def _cross_fade(chosen: NDArray[np.bool_], window: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the average of 1 if chosen and 0 elsewhere over a window; exactly 1 and 0 without an edge in its reach.

    The first and last value extend beyond the ends: nothing fades towards a record that does not exist.
    """
    half, count = window.size // 2, chosen.size
    share = chosen.astype(np.float64)
    # Difference of the average of a unit step and the step, around the step's first sample.
    ramp = np.cumsum(window)[:-1]
    ramp[half:] -= 1.0
    for edge in np.flatnonzero(np.diff(chosen)) + 1:
        reach = slice(max(0, edge - half), min(count, edge + half))
        sign = 1.0 if chosen[edge] else -1.0
        share[reach] += sign * ramp[reach.start - edge + half : reach.stop - edge + half]
    return np.clip(share, 0.0, 1.0)


def _shares(fades: list[NDArray[np.float64] | None], samples: int) -> list[NDArray[np.float64] | None]:
    """Return the share of each playback in the best drive, from its share of restored segments; None for nothing."""
    shares: list[NDArray[np.float64] | None] = [None] * len(fades)
    remaining = np.ones(samples)
    for number in reversed(range(len(fades))):
        back = fades[number]
        if back is None:
            shares[number] = remaining
            break
        shares[number] = remaining * (1.0 - back)
        remaining = remaining * back
    return shares


def _composed(records: list[NDArray[np.float64]], shares: list[NDArray[np.float64] | None]) -> NDArray[np.float64]:
    result = np.zeros_like(records[0])
    for record, share in zip(records, shares, strict=True):
        if share is None:
            continue
        # Most of a record comes from one playback: the others are added only where they have a share.
        edges = np.flatnonzero(np.diff(share > 0.0, prepend=False, append=False))
        for start, end in edges.reshape(-1, 2):
            result[:, start:end] += share[start:end] * record[:, start:end]
    return result


def _power(
    samples: NDArray[np.float64], scale: NDArray[np.float64], *, without: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the sum of the squares of all scaled channels, one after the other to keep the arrays small."""
    power = np.zeros(samples.shape[1])
    scaled = np.empty_like(power)
    for channel in np.flatnonzero(scale):
        if without is None:
            np.multiply(samples[channel], scale[channel], out=scaled)
        else:
            np.subtract(samples[channel], without[channel], out=scaled)
            scaled *= scale[channel]
        scaled *= scaled
        power += scaled
    return power


@dataclass(frozen=True)
class _Smoothing:
    """Average over a window; `lines` is the transform of the window with zeros up to `length` samples."""

    length: int
    half: int
    lines: NDArray[np.complex128]

    @classmethod
    def of(cls, window: NDArray[np.float64], *, samples: int) -> _Smoothing:
        """Transform the window once for all records of `samples` samples."""
        # One transform of the whole record: scipy.signal also has a convolution, but its import takes a second.
        length = fast_length(samples + window.size - 1)
        return cls(length, window.size // 2, forward(window, length))


def _local_energy(
    target: NDArray[np.float64], response: NDArray[np.float64], scale: NDArray[np.float64], smoothing: _Smoothing
) -> NDArray[np.float64]:
    length, half = smoothing.length, smoothing.half
    power = _power(target, scale, without=response)
    energy = backward(forward(power, length) * smoothing.lines, length)[half : half + power.size]
    # Rounding of the transform may give tiny negative energies.
    return np.maximum(energy, 0.0)
