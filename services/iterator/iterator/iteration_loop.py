"""Iteration loop: update, play, judge, until a stop criterion is fulfilled; any Python function can be the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_drive_map import DriveMap
from duralab_spectra import as_record
from iterator.assessment import (
    Forecast,
    IterationMetrics,
    Outcome,
    PassedBound,
    best_at_full_level,
    comparable_history,
    forecast_playback,
    judge_end_at_levels,
    judge_response,
    level_of,
    passed_bound,
    standstills,
)
from iterator.holds import Basis, Decide, Lineage, ProposedPlayback
from iterator.limits import DriveLimits, DriveProjection, UnreachableSegment, unreachable_segments
from iterator.model import IterationHistory, RigModel
from iterator.playbacks import (
    NOTHING_KNOWN,
    CampaignResult,
    CampaignSettings,
    Iteration,
    KnownBefore,
    MapFromFirstPlayback,
    RecordedPlayback,
    fitting_map,
    learned_map,
    mapped_drive,
    playable_drive,
    require_within_bounds,
)
from iterator.updates import NextDrive, Update, chosen_update, own_update, stated_rate_limits, whole_model

Play = Callable[[NDArray[np.float64]], ArrayLike]
"""Function that plays a drive, shape (n_u, samples), and returns the measured response, shape (n_y, samples)."""


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
    decide: Decide | None = None,
    known: KnownBefore = NOTHING_KNOWN,
) -> Iterator[Iteration]:
    """Iterate from `U_0 = 0`, one playback for each yielded value.

    The next drive is made only when the next value is requested, so that a caller can store one step before the next.

    Parameters
    ----------
    play : callable
        Function that plays a drive on the rig.
    target_in_band : array_like, shape (n_y, samples)
        Target from `ControlBand.limit_target`, any length.
    model : RigModel
        Identified model; with a drive map, from mapped drives to responses. A response of weight 0 is monitored:
        neither its target nor its measured values have an effect.
    settings : CampaignSettings
        Settings of the updates and the end.
    limits : DriveLimits, optional
        Drive limits of the rig; not checked if not given.
    recorded : sequence of RecordedPlayback
        First playbacks, if they were made before: they are processed again but not played, so that the iteration
        continues as it would have then. It ends at the last of them at the earliest.
    update : callable, optional
        `(history, model, settings) -> NextDrive`, used instead of the update of `settings.update.kind`. It gets the
        controlled responses only, each playback divided by its level, and cannot write to the history. A function that
        steps from `step_start` applies the acceptance of its settings. With a map its drives are mapped ones.
    drive_map : DriveMap or MapFromFirstPlayback, optional
        Change of drive coordinates `v = T(u)`: the update works on `v`, and `u = T⁻¹(v)` is played. Limits hold for
        `u`, drive after drive: each follows the limited drives that it depends on. Without a map, or
        with the identity, the update works on the drives themselves.
    identification_damage : ndarray, shape (n_y, exponents), optional
        Damage spent by the identification, in passes of the target, counted in the damage budget. NaN for a response
        without a target.
    target_damage : ndarray, shape (n_y, exponents), optional
        Pseudo-damage of one pass of the target as measured; that of the target in the band if not given.
    on_forecast : callable, optional
        Called before each playback with its forecast.
    decide : callable, optional
        Called before each playback with its number and the `ProposedPlayback` until it returns None; then the drive is
        played. If it returns a `Revision`, the drive is made again with other settings or from an earlier playback.
        A recorded playback has no proposal: its earlier revisions are returned again. A drive that cannot be made is
        proposed as refused; its error is raised if there is no revision.
    known : KnownBefore, optional
        Playbacks of earlier campaigns on the same rig, and a first drive.

    Yields
    ------
    Iteration
        Result of each playback, also of the recorded ones; the last one has the outcome.

    Raises
    ------
    DriveLimitError
        A next drive exceeds a limit and the policy is to refuse it; it is not played.
    DriveOverrunError
        The first drive exceeds a limit by more than is projected; it is not played.
    PlaybackBoundError
        The predicted response to a drive exceeds a bound of a playback; it is not played.
    TypeError
        `update` is not a function, or does not return a `NextDrive`.
    ValueError
        The response is not as long as the drive, not finite or of other channels; or the update refuses; or the drive
        of `update` is not finite or of another shape; or the drive map is of another rig, unit or sample rate; or the
        limits of a drive that it moves do not include 0.
    """
    to_learn = drive_map if isinstance(drive_map, MapFromFirstPlayback) else None
    start_map = drive_map.start if isinstance(drive_map, MapFromFirstPlayback) else drive_map
    basis = Basis(as_record(target_in_band, name="target"), model, settings, identification_damage, target_damage)
    own_map, own = (
        fitting_map(start_map, model, limits, update=settings.update),
        None if update is None else own_update(update),
    )
    line = Lineage(basis, limits=limits, drive_map=own_map, keep=decide is not None, known=known)
    metrics: tuple[IterationMetrics, ...] = ()
    outcome, since = None, 0
    while outcome is None:
        number, judged_by = len(metrics) + 1, line.basis
        level = level_of(number, settings.levels)
        if number <= len(recorded):
            while decide is not None and (revision := decide(number, None)) is not None:
                line.revise(revision)
            made = _recorded(recorded[number - 1], line, _step(line, own, level=level, limits=limits), level=level)
            response = recorded[number - 1].response
        else:
            made = _decided(line, own, decide, number=number, level=level, limits=limits)
            if on_forecast is not None:
                on_forecast(made.forecast)
            # Copies: a rig in a notebook may modify its drive, and return the same array every time.
            response = as_record(play(made.drive.copy()), name="response").copy()
        basis, drive, mapped, used = line.basis, made.drive, made.mapped, line.drive_map if made.with_map else None
        if metrics and not basis.judges_as(judged_by):
            since = number - 1
        band, controlled = basis.settings.update.band, basis.controlled
        stood_still = standstills(response, level * basis.target, band=band)
        dead = any(controlled[found.response] for found in stood_still)
        response_in_band = band.limit_response(response) / level
        judged = replace(
            judge_response(
                basis.target,
                response_in_band,
                level=level,
                controlled=controlled,
                measured=response,
                target_damage=basis.target_damage,
            ),
            identification_damage=basis.identification_damage,
        )
        metrics = (*metrics, judged)
        judged_rows = basis.rows(response_in_band)
        forecast = made.forecast.compared(judged_rows, target=basis.controlled_target)
        passed = None if dead else passed_bound(judged, basis.settings.stop, level=level)
        if number >= len(recorded):
            outcome = _outcome(metrics, basis.settings, dead=dead, passed=passed, since=since)
        learned = None
        if to_learn is not None and number == to_learn.number(settings.levels) and not dead:
            learned = learned_map(
                drive,
                response,
                to_learn,
                model=basis.identified,
                target=basis.target,
                controlled=controlled,
                limits=limits,
                update=basis.settings.update,
            )
            if learned.chosen:
                line.drive_map = fitting_map(learned.drive_map, basis.identified, limits, update=basis.settings.update)
                mapped = mapped_drive(drive, line.drive_map, band=band)
        line.add(
            drive=drive,
            mapped=mapped,
            response=response,
            judged=judged_rows,
            level=level,
            model=made.model,
            forecast=forecast,
            number=number,
            made_with=used,
        )
        yield Iteration(
            number=number,
            drive=drive,
            response=response,
            response_in_band=response_in_band,
            metrics=metrics[-1],
            model=whole_model(made.model, identified=basis.identified, controlled=controlled),
            outcome=outcome,
            level=level,
            projection=made.projection,
            unreachable=() if dead else _unreachable(line.history, made.projection, basis=basis),
            stood_still=stood_still,
            passed_bound=passed,
            with_drive_map=made.with_map,
            learned=learned,
            forecast=forecast,
            comparable_from=since + 1,
        )


@dataclass(frozen=True, eq=False)
class _MadeDrive:
    """A playable drive, and the data that it was made with."""

    drive: NDArray[np.float64]
    mapped: NDArray[np.float64]
    model: RigModel
    forecast: Forecast
    projection: DriveProjection | None
    with_map: bool


def _step(line: Lineage, own: Update | None, *, level: float, limits: DriveLimits | None) -> NextDrive:
    """Make the next drive by the update of the settings or of the caller."""
    settings = line.basis.own_settings
    if not line.history.playbacks and (given := line.given_drive()) is not None:
        return NextDrive(drive=given, model=line.model)
    how = settings.update.without_terms if line.is_held else settings.update
    followers = set[int]() if line.drive_map is None else {term.follower for term in line.drive_map.terms}
    stated = stated_rate_limits(limits, how, followers=followers, level=level)
    if followers and not stated:
        # An actuator moves with its own drive, and the update sees the mapped one.
        how = how.without_rate_limits
    model = replace(line.model, stated_rate_limits=stated)
    make = chosen_update(settings.update) if own is None else own
    return make(comparable_history(line.history, settings.levels), model, how)


def _recorded(before: RecordedPlayback, line: Lineage, step: NextDrive, *, level: float) -> _MadeDrive:
    """Return a recorded drive in the form of a new one."""
    with_map = before.with_drive_map and line.drive_map is not None
    band = None if with_map else line.basis.settings.update.band
    mapped = mapped_drive(before.drive, line.drive_map, band=band)
    forecast = _forecast(mapped, step.model, line, level=level)
    return _MadeDrive(before.drive, mapped, step.model, forecast, None, with_map)


def _new(line: Lineage, step: NextDrive, *, number: int, level: float, limits: DriveLimits | None) -> _MadeDrive:
    """Return the next drive, playable and within its bounds."""
    basis = line.basis
    drive, projection = playable_drive(
        step, level=level, limits=limits, settings=basis.own_settings, drive_map=line.drive_map, first=number == 1
    )
    mapped = mapped_drive(drive, line.drive_map)
    require_within_bounds(
        mapped / level,
        basis.model,
        line.history,
        number=number,
        level=level,
        settings=basis.own_settings,
        controlled=basis.controlled,
    )
    forecast = _forecast(mapped, step.model, line, level=level)
    return _MadeDrive(drive, mapped, step.model, forecast, projection, line.drive_map is not None)


def _decided(
    line: Lineage, own: Update | None, decide: Decide | None, *, number: int, level: float, limits: DriveLimits | None
) -> _MadeDrive:
    """Return the next drive, made again until the decision is to play it."""
    while True:
        made, refusal = None, None
        try:
            made = _new(line, _step(line, own, level=level, limits=limits), number=number, level=level, limits=limits)
        except ValueError as error:
            # Other settings may suffice to make the drive.
            if decide is None:
                raise
            refusal = error
        follows = line.numbers[-1] if line.numbers else 0
        proposed = ProposedPlayback(number, level, follows, line.last_drive, refusal=refusal)
        if made is not None:
            proposed = replace(proposed, drive=made.drive, projection=made.projection, forecast=made.forecast)
        revision = None if decide is None else decide(number, proposed)
        if revision is not None:
            line.revise(revision)
        elif made is not None:
            return made
        elif refusal is not None:
            raise refusal


def _forecast(drive: NDArray[np.float64], model: RigModel, line: Lineage, *, level: float) -> Forecast:
    band, earlier = line.basis.settings.update.band, () if line.forecast is None else (line.forecast,)
    return forecast_playback(drive / level, model, line.history, band=band, level=level, earlier=earlier)


def _outcome(
    metrics: tuple[IterationMetrics, ...],
    settings: CampaignSettings,
    *,
    dead: bool,
    passed: PassedBound | None,
    since: int,
) -> Outcome | None:
    """Return why a campaign ends after its last playback, or None."""
    # The values of a dead sensor are not judged: their outcome is arbitrary, and may even be "reached".
    if dead:
        return Outcome.RESPONSE_STOOD_STILL
    if passed is not None:
        return Outcome.BOUND_PASSED
    return judge_end_at_levels(metrics, settings.stop, settings.levels, since=since)


def _unreachable(
    history: IterationHistory, projection: DriveProjection | None, *, basis: Basis
) -> tuple[UnreachableSegment, ...]:
    """Find segments in which the last playback missed the target because of a limit, in the controlled responses."""
    if projection is None:
        return ()
    found = unreachable_segments(
        history.target,
        history.playbacks[-1].response,
        saturated=projection.saturated,
        sample_rate=basis.settings.update.band.sample_rate,
    )
    numbers = np.flatnonzero(basis.controlled)
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
        Function that plays a drive on the rig.
    target : array_like, shape (n_y, samples)
        Target as measured; its dynamic part in the control band is reproduced.
    model : RigModel
        Identified model.
    settings : CampaignSettings
        Settings of the updates and the end.
    limits : DriveLimits, optional
        Drive limits of the rig.
    update : callable, optional
        Update used instead of that of `settings.update.kind`, see `iterate`.
    drive_map : DriveMap or MapFromFirstPlayback, optional
        Change of drive coordinates for the update, see `iterate`.

    Returns
    -------
    CampaignResult
        All playbacks, the reason of the end and the best playback.

    Raises
    ------
    DriveLimitError, TypeError, ValueError
        Errors of `iterate`.
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
