"""Learning of a drive map from one record of the rig: products of drives that explain the residual of the FRF."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_drive_map.drive_map import DriveMap
from duralab_drive_map.frf_model import FrfModel, ModelT
from duralab_drive_map.map_terms import COEFFICIENTS, MapTerm, closes_cycle, product_text
from duralab_drive_map.product_band import LARGEST_BAND_SHARE
from duralab_drive_map.term_regression import (
    PIECE_SECONDS,
    Candidate,
    Folds,
    PieceCut,
    RecordPieces,
    cut_record,
    model_at,
)
from duralab_spectra import as_record, rms

Estimate: TypeAlias = Callable[[NDArray[np.float64]], ModelT]
# Share by which a term must lower the cross-validated residual.
_LEAST_GAIN: Final = 0.02
# The same for a further drive that follows a product of the map before: few candidates, so few by chance.
_LEAST_GAIN_OF_KNOWN: Final = 0.005
# Least distance of a term's coefficients from 0, together, in standard deviations.
_LEAST_SIGNIFICANCE: Final = 4.0
# Each of the two folds has a group of four pieces.
_FEWEST_PIECES: Final = 8
_MOST_TERMS: Final = 24
# An FRF that is estimated on unmapped drives includes part of the arcs, less of it after each round: with two
# rounds a stiff front axle that is identified at 8 mm has 14 % after three playbacks, with three 9 %.
_MOST_ROUNDS: Final = 6
# Share by which a round must lower the residual of the FRF for another round.
_WORTH_A_ROUND: Final = 0.05
# Share of the cross-validated residual above which a term is not an artefact of a wrong FRF.
_BEYOND_DOUBT: Final = 0.2
# Multiple of a drive's RMS above which a record is more informative than the one before. A first playback at a gain of
# 0.7 has 1.4 times the RMS of an experiment at half the target: learned again from it, the second playback of a stiff
# front axle presses 1.05 times as hard as its target instead of 1.19 times.
_LOUDER: Final = 1.2
# With fewer lines for each coefficient a fit follows noise.
_LINES_PER_COEFFICIENT: Final = 4


@dataclass(frozen=True)
class ChosenTerm:
    """Term of a learned drive map and its uncertainty.

    Parameters
    ----------
    term : MapTerm
        Term of the map.
    standard_deviation : tuple of float
        Standard deviation of each coefficient, no unit.
    significance : float
        Distance of the coefficients from 0, together, in standard deviations.
    residual : float
        Cross-validated residual energy with this term and those before it, over that without a term; 0 to 1.
    """

    term: MapTerm
    standard_deviation: tuple[float, ...]
    significance: float
    residual: float


@dataclass(frozen=True)
class LearnedDriveMap(Generic[ModelT]):
    """Drive map learned from a record.

    Parameters
    ----------
    drive_map : DriveMap
        Learned map; the identity if no term was chosen.
    model : FrfModel
        Model from mapped drives to responses; the given model if no term was chosen or no estimate was requested.
    chosen : tuple of ChosenTerm
        Terms in the order in which they were chosen.
    remarks : tuple of str
        Sentences about terms that were not chosen, with the reason.
    """

    drive_map: DriveMap
    model: ModelT
    chosen: tuple[ChosenTerm, ...]
    remarks: tuple[str, ...]


def learn_drive_map(
    drive: ArrayLike,
    response: ArrayLike,
    *,
    model: ModelT,
    names: tuple[str, ...],
    units: tuple[str, ...],
    response_weight: ArrayLike | None = None,
    estimate: Estimate[ModelT] | None = None,
    start: DriveMap | None = None,
    may_follow: Sequence[bool] | None = None,
) -> LearnedDriveMap[ModelT]:
    """Learn a drive map from the record of an identification, or from a first playback.

    Candidates are all products of two drives for every drive. They are chosen one by one: the one that explains most of
    the residual, among those that close no cycle, as long as the cross-validated residual falls by 2 % and the
    coefficients are significant. Then the FRF is estimated again on the mapped drives and the choice is repeated with
    it, until a round lowers the residual by less than 5 %. A term that explains little must also lower the residual of
    the new FRF by 2 %.

    A map that is learned again keeps the terms of the previous one, with new coefficients. Other drives may follow the
    same products, if each lowers the residual by 0.5 %; other products are no candidates, because they also explain
    where the FRF is wrong. The map replaces the previous one only if it lowers the cross-validated residual of the
    record by 2 %, and if the RMS of the drives of all products is 1.2 times that in the record of the previous map: a
    quieter record is less informative.

    Parameters
    ----------
    drive : array_like, shape (n_u, samples)
        Played drive, drive units; the whole record, fades and delays included.
    response : array_like, shape (n_y, samples)
        Measured response, response units, not limited to the control band.
    model : FrfModel
        Model identified on the unmapped drives, or on those that `start` maps.
    names, units : tuple of str
        Names and units of the drives.
    response_weight : array_like, shape (n_y,), optional
        `W`: one over the target's RMS, 0 for a monitored response; if omitted, one over the RMS of each response.
    estimate : callable, optional
        Function of the mapped drive, shape (n_u, samples), that estimates the model again, from the same record; if
        omitted, as for a first playback, the given model is kept.
    may_follow : sequence of bool, optional
        Whether each drive may follow products: True under displacement control. A force-controlled drive moves along an
        arc anyway. All if omitted.
    start : DriveMap, optional
        Map to learn again from a first playback; the identity if omitted.

    Returns
    -------
    LearnedDriveMap
        If the record is too short, or a map is not better than the previous one: `start` or the identity, no chosen
        term, and a sentence.

    Raises
    ------
    ValueError
        If records do not fit each other, the model or the names, or both `estimate` and `start` are given.
    """
    if estimate is not None and start is not None:
        raise ValueError(
            "`estimate` and `start` are both given; omit one: a map is learned again with the model as it is."
        )
    played, measured = as_record(drive, name="drive"), as_record(response, name="response")
    _require_fitting(played, measured, model=model, names=names, units=units)
    if may_follow is not None and len(may_follow) != len(names):
        raise ValueError(f"may_follow has {len(may_follow)} values and there are {len(names)} drives; give one each.")
    level = rms(played)
    known, sample_rate = model.frequency[model.identified], 2.0 * float(model.frequency[-1])
    identity = DriveMap(
        names=names,
        units=units,
        scale=_floats(np.where(level > 0.0, level, 1.0)),
        terms=(),
        sample_rate=sample_rate,
        highest_frequency=min(float(known[-1]), LARGEST_BAND_SHARE * sample_rate),
    )
    cut = PieceCut(played.shape[1], sample_rate=sample_rate, identified=(float(known[0]), identity.highest_frequency))
    followers = np.ones(len(names), dtype=np.bool_) if may_follow is None else np.array(may_follow, dtype=np.bool_)
    pieces = cut_record(played, measured, scale=np.asarray(identity.scale), cut=cut, followers=followers)
    too_little = _too_little(pieces)
    if too_little is not None:
        return LearnedDriveMap(identity if start is None else start, model, (), (too_little,))
    weight = _weight(measured, response_weight)
    folds = Folds.of(pieces, model=model, weight=weight)
    record = _Record(played, cut, pieces, weight, identity, model, folds.whole.energy)
    if start is not None:
        return _learn_again(record, folds, start)
    candidates, remarks = _choose(folds, names)
    if estimate is None or not candidates:
        chosen = _fitted(folds, candidates)
        return LearnedDriveMap(record.map_of(chosen), model, chosen, remarks)
    return _learn_in_rounds(record, folds, candidates, remarks, estimate=estimate)


@dataclass(frozen=True)
class _Record(Generic[ModelT]):
    """Record, its pieces and the residual of the identified model."""

    played: NDArray[np.float64]
    cut: PieceCut
    pieces: RecordPieces
    weight: NDArray[np.float64]
    identity: DriveMap
    model: ModelT
    energy: float
    """float: Energy that the identified model leaves unexplained."""

    def folds(self, model: ModelT) -> Folds:
        return Folds.of(self.pieces, model=model, weight=self.weight)

    def map_of(self, chosen: tuple[ChosenTerm, ...]) -> DriveMap:
        return replace(self.identity, terms=tuple(each.term for each in chosen))

    def estimated(self, chosen: tuple[ChosenTerm, ...], estimate: Estimate[ModelT]) -> tuple[ModelT, float]:
        """Return the model on drives mapped with these terms, and the energy that it leaves unexplained."""
        if not chosen:
            return self.model, self.energy
        mapped = self.map_of(chosen).to_mapped(self.played)
        model = estimate(mapped)
        return model, self.left(mapped, model)

    def left(self, mapped: NDArray[np.float64], model: ModelT) -> float:
        """Return the energy that a model leaves unexplained on mapped drives."""
        lines = self.cut.lines(self.cut.lowered(mapped))
        left = self.pieces.response - np.matmul(model_at(self.pieces.frequency, model), lines)
        return float(np.sum(np.abs(self.weight[:, None] * left) ** 2))


def _learn_in_rounds(
    record: _Record[ModelT],
    folds: Folds,
    candidates: list[Candidate],
    remarks: tuple[str, ...],
    *,
    estimate: Estimate[ModelT],
) -> LearnedDriveMap[ModelT]:
    """Repeat: estimate the model again on mapped drives, and choose again with it."""
    before = record.energy
    result = LearnedDriveMap(record.identity, record.model, (), remarks)
    for _ in range(_MOST_ROUNDS):
        chosen, model, left, dropped = _confirmed(record, folds, candidates, estimate=estimate)
        if not chosen:
            return LearnedDriveMap(record.identity, record.model, (), (*remarks, *dropped))
        if left < before:
            result = LearnedDriveMap(record.map_of(chosen), model, chosen, (*remarks, *dropped))
        if left > (1.0 - _WORTH_A_ROUND) * before:
            break
        before, folds = left, record.folds(model)
        candidates, remarks = _choose(folds, record.identity.names)
    return result


def _learn_again(record: _Record[ModelT], folds: Folds, start: DriveMap) -> LearnedDriveMap[ModelT]:
    """Fit the terms of a map to a louder record, and choose more drives that follow its products."""
    names, model = record.identity.names, record.model
    leaders = sorted({drive for term in start.terms for drive in term.product})
    quieter = [names[i] for i in leaders if record.identity.scale[i] < _LOUDER * start.scale[i]]
    if quieter:
        reason = (
            f"The drive map is not learned again: {', '.join(quieter)} moved less than {_LOUDER:g} times as much as in "
            "the identification."
        )
        return LearnedDriveMap(start, model, (), (reason,))
    number = {product: i for i, product in enumerate(folds.pieces.products)}
    kept = [(term.follower, number[term.product]) for term in start.terms]
    candidates, remarks = _choose(folds, names, kept=kept)
    chosen = _fitted(folds, candidates)
    before = record.left(start.to_mapped(record.played), model) / max(record.energy, np.finfo(np.float64).tiny)
    if not chosen or chosen[-1].residual > (1.0 - _LEAST_GAIN) * before:
        reason = "The drive map is not learned again: that of the identification explains the record as well."
        return LearnedDriveMap(start, model, (), (*remarks, reason))
    return LearnedDriveMap(record.map_of(chosen), model, chosen, remarks)


def _choose(
    folds: Folds, names: tuple[str, ...], *, kept: Sequence[Candidate] = ()
) -> tuple[list[Candidate], tuple[str, ...]]:
    """Choose candidates one by one after the kept ones, and report why one that explains enough was not chosen.

    With kept ones only their products are candidates.
    """
    chosen, known = list(kept), {product for _, product in kept}
    least_gain = _LEAST_GAIN_OF_KNOWN if known else _LEAST_GAIN
    residual = folds.cross_validated(chosen) if chosen else 1.0
    while len(chosen) < _MOST_TERMS:
        best = _best(folds, chosen, known)
        if best is None:
            break
        tried = [*chosen, best]
        left = folds.cross_validated(tried)
        if not left <= (1.0 - least_gain) * residual:
            break
        significance = _significance(folds, tried)[1][-1]
        if significance < _LEAST_SIGNIFICANCE:
            return chosen, (
                f"{_candidate_text(folds, best, names)} is not chosen: its coefficients are {significance:.2g} "
                f"standard deviations away from 0 and {_LEAST_SIGNIFICANCE:g} are needed; a longer or louder record "
                "tells more.",
            )
        chosen, residual = tried, left
    return chosen, ()


def _best(folds: Folds, chosen: list[Candidate], known: Set[int]) -> Candidate | None:
    """Return the candidate that explains most and closes no cycle, of the known products if there are any, or None."""
    products = folds.pieces.products
    terms = [MapTerm(follower, products[number], (0.0,) * COEFFICIENTS) for follower, number in chosen]
    gains = folds.whole.gains(chosen)
    for flat in np.argsort(-gains, axis=None, kind="stable"):
        follower, number = (int(each) for each in np.unravel_index(flat, gains.shape))
        if gains[follower, number] <= 0.0:
            return None
        is_candidate = (follower, number) not in chosen and (not known or number in known)
        if is_candidate and not closes_cycle(follower, products[number], terms):
            return follower, number
    return None


def _confirmed(
    record: _Record[ModelT],
    folds: Folds,
    candidates: list[Candidate],
    *,
    estimate: Estimate[ModelT],
) -> tuple[tuple[ChosenTerm, ...], ModelT, float, tuple[str, ...]]:
    """Drop the last candidates as long as a model that is estimated without them explains the record as well.

    The products also explain errors of the FRF. An FRF that is estimated on mapped drives no longer needs them for
    that.
    """
    chosen = _fitted(folds, candidates)
    model, left = record.estimated(chosen, estimate)
    remarks: list[str] = []
    while chosen and (_in_doubt(chosen) or left > (1.0 - _LEAST_GAIN) * record.energy):
        last = candidates[len(chosen) - 1]
        fewer = _fitted(folds, candidates[: len(chosen) - 1])
        model_without, left_without = record.estimated(fewer, estimate)
        if left <= (1.0 - _LEAST_GAIN) * left_without:
            break
        remarks.append(
            f"{_candidate_text(folds, last, record.identity.names)} is not chosen: with it a model that is estimated "
            f"again leaves {left / max(left_without, np.finfo(np.float64).tiny):.3g} times the energy unexplained, and "
            f"{1.0 - _LEAST_GAIN:g} times or less is needed."
        )
        chosen, model, left = fewer, model_without, left_without
    return chosen, model, left, tuple(remarks)


def _in_doubt(chosen: tuple[ChosenTerm, ...]) -> bool:
    """Return whether the last term explains so little that it may be an artefact of a wrong FRF."""
    *_, before, last = (1.0, *(each.residual for each in chosen))
    return last > (1.0 - _BEYOND_DOUBT) * before


def _fitted(folds: Folds, candidates: list[Candidate]) -> tuple[ChosenTerm, ...]:
    """Return the candidates as terms, with the coefficients of their common fit."""
    if not candidates:
        return ()
    deviation, significance = _significance(folds, candidates)
    coefficients = folds.whole.fit(candidates).reshape(len(candidates), COEFFICIENTS)
    return tuple(
        ChosenTerm(
            term=MapTerm(follower, folds.pieces.products[number], _floats(coefficients[i])),
            standard_deviation=_floats(deviation[i]),
            significance=significance[i],
            residual=folds.cross_validated(candidates[: i + 1]),
        )
        for i, (follower, number) in enumerate(candidates)
    )


def _significance(folds: Folds, candidates: list[Candidate]) -> tuple[NDArray[np.float64], list[float]]:
    """Return the standard deviation of each coefficient, shape (terms, coefficients), and each term's significance."""
    coefficients = folds.whole.fit(candidates)
    covariance = folds.covariance(candidates, coefficients)
    found: list[float] = []
    for i in range(len(candidates)):
        own = slice(COEFFICIENTS * i, COEFFICIENTS * (i + 1))
        distance = float(coefficients[own] @ np.linalg.pinv(covariance[own, own], hermitian=True) @ coefficients[own])
        found.append(float(np.sqrt(max(distance, 0.0) / COEFFICIENTS)))
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(len(candidates), COEFFICIENTS)
    return deviation, found


def _floats(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(float(each) for each in values)


def _candidate_text(folds: Folds, candidate: Candidate, names: tuple[str, ...]) -> str:
    first, second = folds.pieces.products[candidate[1]]
    return f"The term {names[candidate[0]]} after {product_text(names[first], names[second])}"


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
    """Return why a record is too short to select products, or None."""
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
    model: FrfModel,
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
