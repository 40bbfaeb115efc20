"""Responses that stand still while their target moves: their sensor gives nothing, and nothing is made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import as_record, rms
from iterator.band import ControlBand, Segment

# Peak to peak over the target's RMS. Below it a target is silent for a while, and a good rig without noise may be at
# rest. In a stretch longer than a period of the band's lowest frequency, a target that moves goes much further.
_MOVING_SHARE: Final = 0.2
# Peak to peak over the channel's smallest step. A good response stays within one step of its converter for a whole
# period only where it is a twentieth of its target: the first playback at a gain of 0.1 comes to twice that.
_MOVING_STEPS: Final = 20.0
# A converter's step comes again and again. A dead channel that jumps once or twice, because a plug came off, has none.
_FEWEST_CHANGES: Final = 10
# What a band from 0 Hz has in place of the period of its lower edge: a manoeuvre is faster.
_STATIC_BAND_SECONDS: Final = 2.0


@dataclass(frozen=True)
class Standstill:
    """A stretch in which a response stood still to the last bit while its target moved.

    Parameters
    ----------
    response : int
        Which one, from 0.
    segment : Segment
        When.
    """

    response: int
    segment: Segment


def standstills(
    response: NDArray[np.float64], target_in_band: NDArray[np.float64], *, band: ControlBand
) -> tuple[Standstill, ...]:
    """Find responses whose sensor gave nothing.

    Such a sensor does not make the error grow, which stays near 1, but the drive: what is missing is added again after
    every playback.

    Parameters
    ----------
    response : ndarray, shape (n_y, samples)
        As measured: a filter would make a constant move.
    target_in_band : ndarray, shape (n_y, samples)
        What was played for, at the level of the playback.
    band : ControlBand
        Of the campaign.

    Returns
    -------
    tuple of Standstill
        By response, the first stretch of each: all samples equal for longer than one period of the band's lower edge,
        or throughout, while the target moves there by more than a fifth of its RMS and by more than twenty of the
        response's smallest steps, peak to peak. Within such a period all that is in the band moves; quantisation holds
        a response for that time only where its target is small beside one step.

    Raises
    ------
    ValueError
        The records' lengths differ or a value is not finite.
    """
    measured = as_record(response, name="response")
    wanted = as_record(target_in_band, name="target")
    if measured.shape != wanted.shape:
        raise ValueError(
            f"The response has the shape {measured.shape} and the target {wanted.shape}; they must be of the same "
            "instants."
        )
    # A record that is shorter than the period still stands still where it does so throughout.
    period = 1.0 / band.lowest if band.lowest > 0.0 else _STATIC_BAND_SECONDS
    longest = min(period * band.sample_rate, wanted.shape[1] - 1.5)
    level = rms(wanted)
    found: list[Standstill] = []
    for i in range(wanted.shape[0]):
        change = np.abs(np.diff(measured[i]))
        moving = max(_MOVING_SHARE * float(level[i]), _MOVING_STEPS * _smallest_step(change))
        for first, last in _constant_runs(change, longest=longest):
            if np.ptp(wanted[i, first : last + 1]) > moving:
                segment = Segment(start=first / band.sample_rate, end=(last + 1) / band.sample_rate)
                found.append(Standstill(response=i, segment=segment))
                break
    return tuple(found)


def _smallest_step(change: NDArray[np.float64]) -> float:
    steps = change[change > 0.0]
    return float(steps.min()) if steps.size >= _FEWEST_CHANGES else 0.0


def _constant_runs(change: NDArray[np.float64], *, longest: float) -> list[tuple[int, int]]:
    """Return the first and the last sample of each run of equal samples that is longer than so many."""
    still = np.concatenate([[False], change == 0.0, [False]])
    edges = np.flatnonzero(still[1:] != still[:-1])
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2) if last - first > longest]
