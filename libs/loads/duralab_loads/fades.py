"""Fades: a record with smooth ends, and sections of it joined without a step."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record


def rising_fade(samples: int) -> NDArray[np.float64]:
    """Return the weights of a fade: a quarter of a squared sine, from 0 up to 1.

    The reversed fade complements it to 1, so the sum of a fade-out and a fade-in of one signal is the signal.

    Parameters
    ----------
    samples : int
        Length, 0 or more.

    Returns
    -------
    ndarray, shape (samples)
        Weights, rising, above 0 and below 1; one sample rises by no more than pi / 2 / samples.
    """
    return np.sin(0.5 * np.pi * (np.arange(samples) + 0.5) / max(samples, 1)) ** 2


def taper_ends(samples: ArrayLike, *, fade_samples: int, levels: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Taper the ends of every channel to its level.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    fade_samples : int
        Length of each fade, from 0 to half the record.
    levels : array_like, shape () or (channels)
        Level at the start and end of each channel, in its unit.

    Returns
    -------
    ndarray, shape (channels, samples)
        Record, unchanged between the fades.

    Raises
    ------
    ValueError
        If the two fades are longer than the record.
    """
    record = as_record(samples)
    if not 0 <= 2 * fade_samples <= record.shape[1]:
        raise ValueError(
            f"Two fades of {fade_samples} samples do not fit into {record.shape[1]}; each may be half of it at most."
        )
    weights = np.ones(record.shape[1])
    fade = rising_fade(fade_samples)
    weights[:fade_samples] = fade
    weights[record.shape[1] - fade_samples :] = fade[::-1]
    level = np.broadcast_to(np.asarray(levels, dtype=np.float64), record.shape[:1])[:, np.newaxis]
    return level + weights * (record - level)


def join_sections(samples: ArrayLike, sections: Sequence[tuple[int, int]], *, fade_samples: int) -> NDArray[np.float64]:
    """Join sections of a record in the given order; each cross-fades into the next.

    Parameters
    ----------
    samples : array_like, shape (channels, samples)
        Record, each row in its channel's unit.
    sections : sequence of tuple of int
        First sample and the one after the last of each section; sections may overlap and come in any order.
    fade_samples : int
        Overlap of a section with the next, 0 or more; a section in the middle fades at both ends.

    Returns
    -------
    ndarray, shape (channels, joined samples)
        Joined sections, as long as their sum less one fade for each joint. Within a fade from `a` to `b` the slope is
        at most the steeper slope of both and `pi / 2 |b - a| / fade`.

    Raises
    ------
    ValueError
        If there is no section, or a section is outside the record or shorter than its fades.
    """
    record = as_record(samples)
    if not sections:
        raise ValueError("There is no section to join; give one at least.")
    for position, (start, end) in enumerate(sections):
        if not 0 <= start < end <= record.shape[1]:
            raise ValueError(
                f"Section {position} goes from sample {start} to {end}; it must lie within the record of "
                f"{record.shape[1]} and hold a sample."
            )
        fades = fade_samples * ((position > 0) + (position < len(sections) - 1))
        if end - start < fades:
            raise ValueError(
                f"Section {position} is {end - start} samples long and its fades need {fades}; make it longer or the "
                "cross-fade shorter."
            )
    offsets = np.cumsum([0, *(end - start - fade_samples for start, end in sections[:-1])])
    joined = np.zeros((record.shape[0], int(offsets[-1]) + sections[-1][1] - sections[-1][0]))
    fade = rising_fade(fade_samples)
    for position, ((start, end), offset) in enumerate(zip(sections, offsets, strict=True)):
        piece = record[:, start:end].copy()
        if position > 0:
            piece[:, :fade_samples] *= fade
        if position < len(sections) - 1:
            piece[:, end - start - fade_samples :] *= fade[::-1]
        joined[:, offset : offset + end - start] += piece
    return joined


def separate_sections(sections: Sequence[tuple[int, int]], *, fade_samples: int, samples: int) -> list[tuple[int, int]]:
    """Lengthen sections by their fades, so that they are kept whole; sections that then meet are merged."""
    longer = [
        (
            max(0, start - fade_samples) if position > 0 else start,
            min(samples, end + fade_samples) if position < len(sections) - 1 else end,
        )
        for position, (start, end) in enumerate(sections)
    ]
    breaks = [i for i, (before, after) in enumerate(pairwise(longer), start=1) if after[0] > before[1]]
    edges = [0, *breaks, len(longer)]
    return [(longer[first][0], longer[last - 1][1]) for first, last in pairwise(edges)]
