"""A drive map learned from one record of the rig: which products of drives explain what the FRF does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iterator.drive_map.drive_map import DriveMap
from iterator.drive_map.map_terms import COEFFICIENTS, MapTerm, closes_cycle, product_text
from iterator.drive_map.term_regression import PIECE_SECONDS, Candidate, Folds, RecordPieces, cut_record
from iterator.model import RigModel
from spectra import as_record, rms

EstimateModel = Callable[[NDArray[np.float64]], RigModel]
"""Function of the mapped drive, shape (n_u, samples), that estimates the rig's model on it and the same response."""

# Share by which a term must lower the cross-validated residual.
_LEAST_GAIN: Final = 0.02
# Standard deviations that a term's coefficients must be away from 0, together.
_LEAST_SIGNIFICANCE: Final = 4.0
# Two folds of one group each.
_FEWEST_PIECES: Final = 8
_MOST_TERMS: Final = 24
# Fewer lines a coefficient fit noise.
_LINES_PER_COEFFICIENT: Final = 4


@dataclass(frozen=True)
class ChosenTerm:
    """A term of a learned drive map and how well it is known.

    Parameters
    ----------
    term : MapTerm
        The term.
    standard_deviation : tuple of float
        Of each coefficient, no unit.
    significance : float
        How many standard deviations the coefficients are away from 0, together.
    residual : float
        Cross-validated residual energy with this term and those before it, over that without a term; 0 to 1.
    """

    term: MapTerm
    standard_deviation: tuple[float, ...]
    significance: float
    residual: float


@dataclass(frozen=True)
class LearnedDriveMap:
    """What a record says of a rig's drives.

    Parameters
    ----------
    drive_map : DriveMap
        The identity where no term was chosen.
    model : RigModel
        From mapped drives to responses; the given model where no term was chosen or no estimate was asked for.
    chosen : tuple of ChosenTerm
        In the order in which they were chosen.
    remarks : tuple of str
        Sentences about what was not chosen, and why.
    """

    drive_map: DriveMap
    model: RigModel
    chosen: tuple[ChosenTerm, ...]
    remarks: tuple[str, ...]


def learn_drive_map(
    drive: ArrayLike,
    response: ArrayLike,
    *,
    model: RigModel,
    names: tuple[str, ...],
    units: tuple[str, ...],
    response_weight: ArrayLike | None = None,
    estimate: EstimateModel | None = None,
) -> LearnedDriveMap:
    """Learn a drive map from the record of an identification, or from a first playback.

    Candidates are all products of two drives for every drive. They are chosen one by one: the one that explains most of
    what is left, among those that close no cycle, as long as the cross-validated residual falls by 2 % and the
    coefficients are significant. Then the FRF is estimated again on the mapped drives, and the choice made once more.

    Parameters
    ----------
    drive : array_like, shape (n_u, samples)
        As played, drive units; the whole record, fades and delays included.
    response : array_like, shape (n_y, samples)
        As measured, response units, not limited to the control band.
    model : RigModel
        Identified on the drives as they are.
    names, units : tuple of str
        Of the drives.
    response_weight : array_like, shape (n_y,), optional
        `W`: one over the target's RMS, 0 for a watched response. One over the RMS of each response where not given.
    estimate : callable, optional
        Estimates the model again, of the same record; the given model stays where not given, as for a first playback.

    Returns
    -------
    LearnedDriveMap
        The identity, with a sentence, where the record is too short or holds no such products.

    Raises
    ------
    ValueError
        Records do not fit each other, the model or the names.
    """
    played, measured = as_record(drive, name="drive"), as_record(response, name="response")
    _require_fitting(played, measured, model=model, names=names, units=units)
    level = rms(played)
    scale = np.where(level > 0.0, level, 1.0)
    known = model.frequency[model.identified]
    sample_rate = 2.0 * float(model.frequency[-1])

    def map_of(terms: tuple[MapTerm, ...]) -> DriveMap:
        return DriveMap(
            names=names,
            units=units,
            scale=tuple(float(each) for each in scale),
            terms=terms,
            sample_rate=sample_rate,
            highest_frequency=min(float(known[-1]), 0.45 * sample_rate),
        )

    identity = map_of(())
    pieces = cut_record(
        played,
        measured,
        scale=scale,
        sample_rate=sample_rate,
        identified=(float(known[0]), identity.highest_frequency),
    )
    weight = _weight(measured, response_weight)
    too_little = _too_little(pieces)
    if too_little is not None:
        return LearnedDriveMap(identity, model, (), (too_little,))
    chosen, remarks = _choose(Folds.of(pieces, model=model, weight=weight), names=names)
    if not chosen or estimate is None:
        return LearnedDriveMap(map_of(_terms(chosen)), model, chosen, remarks)
    better = estimate(map_of(_terms(chosen)).to_mapped(played))
    chosen, remarks = _choose(Folds.of(pieces, model=better, weight=weight), names=names)
    if not chosen:
        return LearnedDriveMap(identity, model, (), remarks)
    learned = map_of(_terms(chosen))
    return LearnedDriveMap(learned, estimate(learned.to_mapped(played)), chosen, remarks)


def _choose(folds: Folds, *, names: tuple[str, ...]) -> tuple[tuple[ChosenTerm, ...], tuple[str, ...]]:
    """Choose terms one by one, and say why the last one looked at was not chosen."""
    pieces = folds.pieces
    chosen: list[Candidate] = []
    residuals = [1.0]
    remarks: list[str] = []
    while len(chosen) < _MOST_TERMS:
        best = _best(folds, chosen)
        if best is None:
            break
        left = folds.cross_validated([*chosen, best])
        if not left <= (1.0 - _LEAST_GAIN) * residuals[-1]:
            break
        tried = [*chosen, best]
        significance = _significance(folds, tried)[1][-1]
        if significance < _LEAST_SIGNIFICANCE:
            first, second = pieces.products[best[1]]
            remarks.append(
                f"{names[best[0]]} may follow {product_text(names[first], names[second])}; its coefficients are only "
                f"{significance:.2g} standard deviations away from 0 and it is not chosen: at least "
                f"{_LEAST_SIGNIFICANCE:g} are needed, from a longer or louder record."
            )
            break
        chosen, residuals = tried, [*residuals, left]
    if not chosen:
        return (), tuple(remarks)
    deviation, significance_of = _significance(folds, chosen)
    coefficients = folds.whole.fit(chosen).reshape(len(chosen), COEFFICIENTS)
    return tuple(
        ChosenTerm(
            term=MapTerm(follower, pieces.products[number], tuple(float(each) for each in coefficients[i])),
            standard_deviation=tuple(float(each) for each in deviation[i]),
            significance=significance_of[i],
            residual=residuals[i + 1],
        )
        for i, (follower, number) in enumerate(chosen)
    ), tuple(remarks)


def _best(folds: Folds, chosen: list[Candidate]) -> Candidate | None:
    """Return the candidate that explains most and closes no cycle, or None."""
    products = folds.pieces.products
    terms = [MapTerm(follower, products[number], (0.0,) * COEFFICIENTS) for follower, number in chosen]
    gains = folds.whole.gains(chosen)
    for flat in np.argsort(-gains, axis=None, kind="stable"):
        follower, number = (int(each) for each in np.unravel_index(flat, gains.shape))
        if gains[follower, number] <= 0.0:
            return None
        if (follower, number) not in chosen and not closes_cycle(follower, products[number], terms):
            return follower, number
    return None


def _significance(folds: Folds, chosen: list[Candidate]) -> tuple[NDArray[np.float64], list[float]]:
    """Return the standard deviations of the coefficients, shape (terms, coefficients), and each term's significance."""
    coefficients = folds.whole.fit(chosen)
    covariance = folds.doubt(chosen, coefficients)
    found: list[float] = []
    for i in range(len(chosen)):
        own = slice(COEFFICIENTS * i, COEFFICIENTS * (i + 1))
        distance = float(coefficients[own] @ np.linalg.pinv(covariance[own, own], hermitian=True) @ coefficients[own])
        found.append(float(np.sqrt(max(distance, 0.0) / COEFFICIENTS)))
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(len(chosen), COEFFICIENTS)
    return deviation, found


def _terms(chosen: tuple[ChosenTerm, ...]) -> tuple[MapTerm, ...]:
    return tuple(each.term for each in chosen)


def _weight(measured: NDArray[np.float64], given: ArrayLike | None) -> NDArray[np.float64]:
    if given is None:
        level = np.std(measured, axis=1)
        return np.divide(1.0, level, out=np.zeros_like(level), where=level > 0.0)
    weight = np.asarray(given, dtype=np.float64)
    if weight.shape != measured.shape[:1] or not (np.all(np.isfinite(weight)) and np.all(weight >= 0.0)):
        raise ValueError(
            f"The response weight is {weight}; it must be one finite value, 0 or more, for each of "
            f"{measured.shape[0]} responses."
        )
    return weight


def _too_little(pieces: RecordPieces) -> str | None:
    """Return why a record cannot tell which products count, or None."""
    if pieces.count < _FEWEST_PIECES:
        seconds = (_FEWEST_PIECES + 1) * PIECE_SECONDS / 2.0
        return (
            f"No drive map is learned: the record holds {pieces.count} pieces of {PIECE_SECONDS:g} s and "
            f"{_FEWEST_PIECES} are needed; record {seconds:g} s or more."
        )
    lines = pieces.frequency.size
    if lines < COEFFICIENTS * _LINES_PER_COEFFICIENT:
        return (
            f"No drive map is learned: the identified band holds {lines} lines of {PIECE_SECONDS:g} s and "
            f"{COEFFICIENTS * _LINES_PER_COEFFICIENT} are needed; identify a wider band."
        )
    return None


def _require_fitting(
    played: NDArray[np.float64],
    measured: NDArray[np.float64],
    *,
    model: RigModel,
    names: tuple[str, ...],
    units: tuple[str, ...],
) -> None:
    if played.shape[1] != measured.shape[1]:
        raise ValueError(
            f"The drive has {played.shape[1]} samples and the response {measured.shape[1]}; a map is learned from "
            "both of one record."
        )
    shape = (measured.shape[0], played.shape[0])
    if model.frf.shape[1:] != shape:
        raise ValueError(
            f"The record has {shape[0]} responses and {shape[1]} drives and the model {model.frf.shape[1]} and "
            f"{model.frf.shape[2]}; a map is learned on the rig that the model is of."
        )
    if not len(names) == len(units) == shape[1]:
        raise ValueError(
            f"There are {len(names)} names and {len(units)} units for {shape[1]} drives; give one of each."
        )
