"""Detection of responses that stand still while their target moves, because their sensor is dead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import as_record, rms
from iterator.band import ControlBand, Segment

# Peak to peak over the target's RMS. Below it a target is silent for some time, and a good rig without noise may be at
# rest. In a segment longer than a period of the band's lowest frequency, a moving target exceeds it by far.
_MOVING_SHARE: Final = 0.2
# Peak to peak over the channel's smallest step. A good response stays within one step of its converter for a whole
# period only if it is a twentieth of its target: the first playback at a gain of 0.1 is twice that.
_MOVING_STEPS: Final = 20.0
# A converter's step repeats often. A dead channel that jumps once or twice, because a plug came off, has no step.
_FEWEST_CHANGES: Final = 10
# Replaces the period of the lower edge for a band from 0 Hz: a manoeuvre is faster.
_STATIC_BAND_SECONDS: Final = 2.0


@dataclass(frozen=True)
class Standstill:
    """A segment in which a response was exactly constant while its target moved.

    Parameters
    ----------
    response : int
        Row of the response, from 0.
    segment : Segment
        Time segment.
    """

    response: int
    segment: Segment


def standstills(
    response: NDArray[np.float64], target_in_band: NDArray[np.float64], *, band: ControlBand
) -> tuple[Standstill, ...]:
    """Find responses of dead sensors.

    The error of such a response stays near 1, but its drive grows: the missing part is added again after every
    playback.

    Parameters
    ----------
    response : ndarray, shape (n_y, samples)
        Response as measured: a filter would make a constant move.
    target_in_band : ndarray, shape (n_y, samples)
        Target of the playback at its level.
    band : ControlBand
        Control band of the campaign.

    Returns
    -------
    tuple of Standstill
        By response, the first segment of each: all samples are equal for longer than one period of the band's lower
        edge, or throughout, while the target moves in it by more than a fifth of its RMS and by more than twenty of
        the response's smallest steps, peak to peak. Within such a period all content of the band moves; quantisation
        holds a response for that time only if its target is small compared with one step.

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
    # A record shorter than the period stands still if it is constant throughout.
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
    """Return the first and the last sample of each run of equal samples longer than `longest`."""
    still = np.concatenate([[False], change == 0.0, [False]])
    edges = np.flatnonzero(still[1:] != still[:-1])
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2) if last - first > longest]
