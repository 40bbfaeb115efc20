"""The iteration itself: update, play, judge, until a stop criterion says so; any Python function can be the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import InstanceOf, model_validator

from duralab_drive_map import DriveMap, LearnedDriveMap, learn_drive_map
from duralab_settings import LimitPolicy, PlaybackSettings, StopCriteria
from duralab_spectra import as_record, rms
from iterator.assessment import (
    Forecast,
    IterationMetrics,
    Outcome,
    PassedBound,
    PlaybackBoundError,
    Standstill,
    best_at_full_level,
    comparable_history,
    forecast_playback,
    is_bounded,
    judge_end_at_levels,
    judge_response,
    level_of,
    partial_playbacks,
    passed_bound,
    standstills,
)
from iterator.band import DRIVE_FADE_SECONDS, ControlBand, faded
from iterator.limits import (
    DriveLimits,
    DriveProjection,
    UnreachableSegment,
    drive_within_limits,
    held_share,
    project_drive,
    project_mapped_drive,
    require_rest_within_limits,
    require_small_overrun,
    require_within_limits,
    unreachable_segments,
    wanted_drive,
)
from iterator.model import IterationHistory, Playback, RigModel, predict
from iterator.updates import (
    UPDATES,
    NextDrive,
    Update,
    UpdateSettings,
    controlled_model,
    controlled_responses,
    controlled_settings,
    own_update,
    whole_model,
)

Play = Callable[[NDArray[np.float64]], ArrayLike]
"""Plays a drive, shape (n_u, samples), and returns the measured response, shape (n_y, samples)."""

# Share of the time that the last drive stood at a limit, above which its nonlinear terms are not used: a drive that is
# cut off does not do what its square foresees. With 85 % of the stroke that a target needs it is 0.6 to 1 %.
_MOST_HELD: Final = 0.002


class CampaignSettings(PlaybackSettings):
    """How to iterate and when to end; its other fields are those of `PlaybackSettings`.

    Parameters
    ----------
    update : UpdateSettings
        Kind, control band, gains and safeguards.
    stop : StopCriteria
        When to end.

    Raises
    ------
    ValueError
        A value is not allowed, or the levels leave no playback at full level.
    """

    # A notebook asks for projection by name; a campaign file has it by default.
    limit_policy: LimitPolicy = LimitPolicy.REFUSE
    update: InstanceOf[UpdateSettings]
    stop: InstanceOf[StopCriteria]

    @model_validator(mode="after")
    def _check_whole_playback(self) -> Self:
        self.require_whole_playback(self.stop)
        return self


@dataclass(frozen=True)
class RecordedPlayback:
    """A playback that was made before, and is not to be made again.

    Parameters
    ----------
    drive : ndarray, shape (n_u, samples)
        As played.
    response : ndarray, shape (n_y, samples)
        As measured.
    with_drive_map : bool
        Whether the drive was made with the drive map that the campaign iterates with; False for a playback that was
        made before the map was learned. It has no effect without a map.
    """

    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    with_drive_map: bool = True


@dataclass(frozen=True)
class MapFromFirstPlayback:
    """The drive map is learned from the first playback, or again from the first at full level where there is one.

    Parameters
    ----------
    names, units : tuple of str
        Of the drives, in the rig's order.
    may_follow : tuple of bool, optional
        Which drives may follow products: those under displacement control; all where not given.
    start : DriveMap, optional
        Map of the identification, which the first playbacks are made with. It stays where the playback does not say
        more: see `duralab_drive_map.learn_drive_map`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    may_follow: tuple[bool, ...] | None = None
    start: DriveMap | None = None

    def number(self, levels: Sequence[float]) -> int:
        """Return the number of the playback to learn from.

        A playback at a part of the level is too quiet to improve on a map. None of them is in the history of those that
        follow the first one at full level, so that no drive has to be mapped again.
        """
        return 1 if self.start is None else partial_playbacks(levels) + 1


@dataclass(frozen=True)
class Iteration:
    """One playback and what was made of it.

    Parameters
    ----------
    number : int
        From 1.
    drive : ndarray, shape (n_u, samples)
        As played. Updates work on `DriveMap.to_mapped` of it where there is a drive map.
    response : ndarray, shape (n_y, samples)
        As measured.
    response_in_band : ndarray, shape (n_y, samples)
        As judged: divided by the level.
    metrics : IterationMetrics
        In the control band.
    model : RigModel
        What the drive was made with.
    outcome : Outcome or None
        Why this is the last one; None where it goes on.
    level : float
        Share of the target that was played for.
    projection : DriveProjection or None
        What was changed in the drive to hold the rig's limits, empty where it fitted; None where drives beyond them
        are refused, and for a recorded playback.
    unreachable : tuple of UnreachableSegment
        Where responses missed the target because a drive was held at its limits.
    stood_still : tuple of Standstill
        Where responses stood still while their target moved; after a controlled one nothing is made of the playback.
    passed_bound : PassedBound or None
        The bound of a playback that a controlled response passed furthest.
    with_drive_map : bool
        Whether the drive was made with a drive map.
    learned : LearnedDriveMap or None
        The drive map that was learned from this playback; later drives are made with it.
    forecast : Forecast or None
        What was predicted of the controlled responses before the playback, and how far it was missed.
    """

    number: int
    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    response_in_band: NDArray[np.float64]
    metrics: IterationMetrics
    model: RigModel
    outcome: Outcome | None
    level: float = 1.0
    projection: DriveProjection | None = None
    unreachable: tuple[UnreachableSegment, ...] = ()
    stood_still: tuple[Standstill, ...] = ()
    passed_bound: PassedBound | None = None
    with_drive_map: bool = False
    learned: LearnedDriveMap[RigModel] | None = None
    forecast: Forecast | None = None


@dataclass(frozen=True)
class CampaignResult:
    """Everything that an iteration made.

    Parameters
    ----------
    target_in_band : ndarray, shape (n_y, samples)
        What the responses were judged against.
    iterations : tuple of Iteration
        From the first to the last.
    outcome : Outcome
        Why it ended.
    best_iteration : int
        Number of the playback with the smallest error over all channels, from 1.
    """

    target_in_band: NDArray[np.float64]
    iterations: tuple[Iteration, ...]
    outcome: Outcome
    best_iteration: int


def iterate(
    play: Play,
    target_in_band: ArrayLike,
    *,
    model: RigModel,
    settings: CampaignSettings,
    limits: DriveLimits | None = None,
    recorded: Sequence[RecordedPlayback] = (),
    update: Update | None = None,
    drive_map: DriveMap | MapFromFirstPlayback | None = None,
    identification_damage: NDArray[np.float64] | None = None,
    target_damage: NDArray[np.float64] | None = None,
    on_forecast: Callable[[Forecast], None] | None = None,
) -> Iterator[Iteration]:
    """Iterate from `U_0 = 0`, one playback for each value yielded.

    The next drive is made only when the next value is asked for, so that a caller can store one step before the next.

    Parameters
    ----------
    play : callable
        The rig.
    target_in_band : array_like, shape (n_y, samples)
        From `ControlBand.limit_target`, any length.
    model : RigModel
        As identified, with a drive map from mapped drives to responses. A response of weight 0 is watched: neither its
        target nor what is measured there matters.
    settings : CampaignSettings
        How and how long.
    limits : DriveLimits, optional
        Of the rig; not checked where not given.
    recorded : sequence of RecordedPlayback
        The first playbacks, where they were made before: they are gone through again and not played, so that what
        follows is what would have followed then. Only after the last of them it may end.
    update : callable, optional
        `(history, model, settings) -> NextDrive`, used in place of the update of `settings.update.kind`. It sees the
        controlled responses only, each playback divided by its level, and cannot write to the history. A function that
        steps from `step_start` honours the acceptance of its settings. Its drives are mapped ones where there is a map.
    drive_map : DriveMap or MapFromFirstPlayback, optional
        Change of drive coordinates `v = T(u)`: the update works on `v`, and `u = T⁻¹(v)` is played. Limits hold for
        `u`, drive after drive: each follows what the limits leave of those that it depends on. Without a map, or
        with the identity, the update works on the drives themselves.
    identification_damage : ndarray, shape (n_y, exponents), optional
        Damage spent by the identification, in passes of the target: it counts for the damage budget. Not a number for a
        response without a target.
    target_damage : ndarray, shape (n_y, exponents), optional
        Pseudo-damage of one pass of the target as measured; that of the target in the band where not given.
    on_forecast : callable, optional
        Called before each playback with what is predicted of it.

    Yields
    ------
    Iteration
        After each playback, also the recorded ones; the last one carries the outcome.

    Raises
    ------
    DriveLimitError
        A next drive would pass a limit and the policy is to refuse it; it is not played.
    DriveOverrunError
        The first drive would pass a limit by more than is projected; it is not played.
    PlaybackBoundError
        The response that the model predicts of a drive passes a bound of a playback; it is not played.
    TypeError
        `update` is not a function, or does not return a `NextDrive`.
    ValueError
        The response played back is not as long as the drive, not finite or of other channels, or the update refuses, or
        the drive that `update` returns is not finite or of another shape, or the drive map is of another rig, unit or
        sample rate, or the limits of a drive that it moves do not hold 0.
    """
    to_learn = drive_map if isinstance(drive_map, MapFromFirstPlayback) else None
    own_map = _fitting_map(drive_map.start if isinstance(drive_map, MapFromFirstPlayback) else drive_map, model, limits)
    target, identified = as_record(target_in_band, name="target"), model
    controlled = controlled_responses(model)
    own_settings, model = controlled_settings(settings.update, controlled), controlled_model(model, controlled)
    history = IterationHistory(target=_rows(target, controlled))
    make_step = UPDATES[settings.update.kind] if update is None else own_update(update)
    metrics: tuple[IterationMetrics, ...] = ()
    forecasts: tuple[Forecast, ...] = ()
    outcome = None
    own, first_model, held = settings.model_copy(update={"update": own_settings}), model, False
    while outcome is None:
        number, projection = len(metrics) + 1, None
        level = level_of(number, settings.levels)
        how = own_settings.without_terms if held else own_settings
        step = make_step(comparable_history(history, settings.levels), model, how)
        model = step.model
        if number <= len(recorded):
            before = recorded[number - 1]
            drive, response, with_map = before.drive, before.response, before.with_drive_map and own_map is not None
            mapped = _mapped(drive, own_map, band=None if with_map else settings.update.band)
            forecast = _forecast(mapped, model, history, settings=settings, level=level, earlier=forecasts)
        else:
            drive, projection = _playable_drive(
                step, level=level, limits=limits, settings=own, drive_map=own_map, first=number == 1
            )
            mapped, with_map = _mapped(drive, own_map), own_map is not None
            _require_within_bounds(
                mapped / level, first_model, history, number=number, level=level, settings=own, controlled=controlled
            )
            forecast = _forecast(mapped, model, history, settings=settings, level=level, earlier=forecasts)
            if on_forecast is not None:
                on_forecast(forecast)
            # Copies: a rig in a notebook may work in its drive's memory, and answer from the same memory every time.
            response = as_record(play(drive.copy()), name="response").copy()
        stood_still = standstills(response, level * target, band=settings.update.band)
        dead = any(controlled[found.response] for found in stood_still)
        held = limits is not None and held_share(drive, limits) > _MOST_HELD
        response_in_band = settings.update.band.limit_response(response) / level
        judged = replace(
            judge_response(
                target,
                response_in_band,
                level=level,
                controlled=controlled,
                measured=response,
                target_damage=target_damage,
            ),
            identification_damage=identification_damage,
        )
        metrics = (*metrics, judged)
        judged_rows = _rows(response_in_band, controlled)
        forecasts = (*forecasts, forecast.compared(judged_rows, target=history.target))
        passed = None if dead else passed_bound(judged, settings.stop, level=level)
        if number >= len(recorded):
            outcome = _outcome(metrics, settings, dead=dead, passed=passed)
        learned = None
        if to_learn is not None and number == to_learn.number(settings.levels) and not dead:
            learned = _learned(
                drive, response, to_learn, model=identified, target=target, controlled=controlled, limits=limits
            )
            if learned.chosen:
                own_map = learned.drive_map
                mapped = _mapped(drive, own_map, band=settings.update.band)
        history = history.after(Playback(drive=mapped / level, response=judged_rows))
        yield Iteration(
            number=number,
            drive=drive,
            response=response,
            response_in_band=response_in_band,
            metrics=metrics[-1],
            model=whole_model(model, identified=identified, controlled=controlled),
            outcome=outcome,
            level=level,
            projection=projection,
            unreachable=() if dead else _unreachable(history, projection, settings=settings, controlled=controlled),
            stood_still=stood_still,
            passed_bound=passed,
            with_drive_map=with_map,
            learned=learned,
            forecast=forecasts[-1],
        )


def _forecast(
    drive: NDArray[np.float64],
    model: RigModel,
    history: IterationHistory,
    *,
    settings: CampaignSettings,
    level: float,
    earlier: Sequence[Forecast],
) -> Forecast:
    return forecast_playback(drive / level, model, history, band=settings.update.band, level=level, earlier=earlier)


def _learned(
    drive: NDArray[np.float64],
    response: NDArray[np.float64],
    to_learn: MapFromFirstPlayback,
    *,
    model: RigModel,
    target: NDArray[np.float64],
    controlled: NDArray[np.bool_],
    limits: DriveLimits | None,
) -> LearnedDriveMap[RigModel]:
    """Learn a drive map from the first playback; the one before, with a sentence, where the limits do not allow it."""
    learned = learn_drive_map(
        drive,
        response,
        model=model,
        names=to_learn.names,
        units=to_learn.units,
        response_weight=np.divide(1.0, rms(target), out=np.zeros(len(target)), where=controlled),
        start=to_learn.start,
        may_follow=to_learn.may_follow,
    )
    try:
        _fitting_map(learned.drive_map, model, limits)
    except ValueError as error:
        before = to_learn.start or replace(learned.drive_map, terms=())
        return replace(learned, drive_map=before, chosen=(), remarks=(*learned.remarks, f"{error}."))
    return learned


def _fitting_map(drive_map: DriveMap | None, model: RigModel, limits: DriveLimits | None) -> DriveMap | None:
    """Return a drive map that fits model and limits, or None for the identity."""
    if drive_map is None:
        return None
    drive_map.require_model(model)
    if limits is not None:
        drive_map.require_drives(limits.names, limits.units, sample_rate=limits.sample_rate)
        require_rest_within_limits(drive_map, limits)
    return None if drive_map.is_identity else drive_map


def _mapped(
    drive: NDArray[np.float64], drive_map: DriveMap | None, *, band: ControlBand | None = None
) -> NDArray[np.float64]:
    """Return a drive as updates see it; `band` for one that was made without the map.

    What `T(u)` of such a drive has outside the band would stay in every drive that follows; a drive that is made with
    the map has its mapped drive in the band already.
    """
    if drive_map is None:
        return drive
    mapped = drive_map.to_mapped(drive)
    return mapped if band is None else band.limit_drive(mapped)


def _require_within_bounds(
    drive: NDArray[np.float64],
    model: RigModel,
    history: IterationHistory,
    *,
    number: int,
    level: float,
    settings: CampaignSettings,
    controlled: NDArray[np.bool_],
) -> None:
    """Refuse a drive of which the identified model predicts that a playback passes its bounds.

    The prediction is the last response and what the model says of the step from its drive. What is unknown of a rig,
    friction and arcs, is in the last response as far as the step is small. The identified model, because one that an
    update has bent foresees what that update wants. The drive is a mapped one where there is a map.
    """
    if not is_bounded(settings.stop):
        return
    if history.playbacks:
        last = history.playbacks[-1]
        predicted = last.response + predict(model, drive - last.drive, band=settings.update.band)
    else:
        predicted = predict(model, drive, band=settings.update.band)
    passed = passed_bound(judge_response(history.target, predicted, level=level), settings.stop, level=level)
    if passed is not None:
        row = int(np.flatnonzero(controlled)[passed.response])
        raise PlaybackBoundError(number, replace(passed, response=row))


def _outcome(
    metrics: tuple[IterationMetrics, ...], settings: CampaignSettings, *, dead: bool, passed: PassedBound | None
) -> Outcome | None:
    """Return why a campaign ends after its last playback, or None."""
    # What a dead sensor told is not judged: it may come out as anything, even as reached.
    if dead:
        return Outcome.RESPONSE_STOOD_STILL
    if passed is not None:
        return Outcome.BOUND_PASSED
    return judge_end_at_levels(metrics, settings.stop, settings.levels)


def _playable_drive(
    step: NextDrive,
    *,
    level: float,
    limits: DriveLimits | None,
    settings: CampaignSettings,
    drive_map: DriveMap | None,
    first: bool,
) -> tuple[NDArray[np.float64], DriveProjection | None]:
    """Return the next drive at its level, from rest to rest and within the limits, and what was changed for them."""
    band = settings.update.band
    whole = faded(step.drive, sample_rate=band.sample_rate, seconds=DRIVE_FADE_SECONDS)
    drive = level * whole

    def at_rest(_i: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        # A drive that follows others rings about as far as its map is cut off above the identified band.
        return faded(row[None, :].copy(), sample_rate=band.sample_rate, seconds=DRIVE_FADE_SECONDS)[0]

    if limits is None:
        return drive if drive_map is None else drive_map.to_drive(drive, adjust=at_rest), None
    if settings.limit_policy is LimitPolicy.PROJECT:
        if first:
            if drive_map is not None:
                whole = wanted_drive(whole, drive_map=drive_map, limits=limits, band=band)
            require_small_overrun(whole, limits=limits, allowed=settings.largest_overrun)
        if drive_map is None:
            projection = project_drive(drive, limits=limits, band=band)
        else:
            projection = project_mapped_drive(drive, drive_map=drive_map, limits=limits, band=band, adjust=at_rest)
        return projection.drive, projection
    last, gains = None if step.stepped_from is None else level * step.stepped_from, settings.update.gains
    if drive_map is None:
        require_within_limits(drive, last_drive=last, limits=limits, iteration_gain=gains)
    else:
        drive = drive_within_limits(
            drive, last_mapped=last, drive_map=drive_map, limits=limits, iteration_gain=gains, adjust=at_rest
        )
    return drive, None


def _rows(samples: NDArray[np.float64], controlled: NDArray[np.bool_]) -> NDArray[np.float64]:
    return samples if controlled.all() else np.ascontiguousarray(samples[controlled])


def _unreachable(
    history: IterationHistory,
    projection: DriveProjection | None,
    *,
    settings: CampaignSettings,
    controlled: NDArray[np.bool_],
) -> tuple[UnreachableSegment, ...]:
    """Find where the last playback missed the target because of a limit, among the controlled responses."""
    if projection is None:
        return ()
    found = unreachable_segments(
        history.target,
        history.playbacks[-1].response,
        saturated=projection.saturated,
        sample_rate=settings.update.band.sample_rate,
    )
    numbers = np.flatnonzero(controlled)
    return tuple(replace(segment, response=int(numbers[segment.response])) for segment in found)


def run_campaign(
    play: Play,
    target: ArrayLike,
    *,
    model: RigModel,
    settings: CampaignSettings,
    limits: DriveLimits | None = None,
    update: Update | None = None,
    drive_map: DriveMap | MapFromFirstPlayback | None = None,
) -> CampaignResult:
    """Iterate to the end; see `iterate`.

    Parameters
    ----------
    play : callable
        The rig.
    target : array_like, shape (n_y, samples)
        As measured; its dynamic part in the control band is reproduced.
    model : RigModel
        As identified.
    settings : CampaignSettings
        How and how long.
    limits : DriveLimits, optional
        Of the rig.
    update : callable, optional
        Used in place of the update of `settings.update.kind`, see `iterate`.
    drive_map : DriveMap or MapFromFirstPlayback, optional
        Change of drive coordinates that the update works in, see `iterate`.

    Returns
    -------
    CampaignResult
        All playbacks, why it ended and which was best.

    Raises
    ------
    DriveLimitError, TypeError, ValueError
        As `iterate` does.
    """
    target_in_band = settings.update.band.limit_target(as_record(target, name="target"))
    iterations = tuple(
        iterate(
            play,
            target_in_band,
            model=model,
            settings=settings,
            limits=limits,
            update=update,
            drive_map=drive_map,
        )
    )
    outcome = iterations[-1].outcome
    if outcome is None:
        raise AssertionError("The last iteration carries the outcome.")
    return CampaignResult(
        target_in_band=target_in_band,
        iterations=iterations,
        outcome=outcome,
        best_iteration=best_at_full_level(
            tuple(iteration.metrics for iteration in iterations), settings.levels, outcome=outcome
        ),
    )
