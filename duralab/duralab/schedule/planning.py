"""Design and forecast of a schedule: damage plan, repeats, totals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import numpy as np

from duralab.arguments import require_path
from duralab.display import html_table, text_table
from duralab.errors import InputError
from duralab.schedule.events import (
    PreparedEvent,
    damage_of,
    left_out_of,
    prepare_events,
    require_same_units,
    signals_in_si,
)
from duralab_schedules import (
    MOST_REPEATS,
    DamagePlan,
    Forecast,
    Order,
    Schedule,
    ScheduleError,
    design,
    forecast,
    in_bytes,
    read_schedule,
    require_room,
    require_within_plan,
)

_EVENTS = ("event", "repeats", "one repeat", "kept", "drive")
_CHANNELS = ("channel", "damage plan", "planned damage", "ratio")


@dataclass(frozen=True, eq=False)
class ScheduleForecast:
    """Schedule with its totals; prints as a table.

    Parameters
    ----------
    schedule : Schedule
        Schedule with the repeats of every event.
    events : dict of str to PreparedEvent
        Events with their drives.
    planned : dict of str to float
        Damage plan by response; empty without a plan.
    forecast : Forecast
        Duration, damage and bytes on disk.
    notes : tuple of str
        Sentences about channels outside the plan, and about unknown damage.
    """

    schedule: Schedule
    events: dict[str, PreparedEvent]
    planned: dict[str, float]
    forecast: Forecast
    notes: tuple[str, ...] = ()

    @property
    def misfit(self) -> float:
        """Root mean square over the planned channels of (planned damage / damage plan - 1); NaN without a plan."""
        return float(np.sqrt(np.mean([(ratio - 1.0) ** 2 for ratio in self.forecast.ratio.values()] or [np.nan])))

    @property
    def self_contained(self) -> Schedule:
        """Schedule with its plan as damage by response, so that it does not need the files of a mix."""
        if self.schedule.plan is None:
            return self.schedule
        plan = DamagePlan(damage=self.planned, largest_ratio=self.schedule.plan.largest_ratio)
        return self.schedule.model_copy(update={"plan": plan}).read_from(self.schedule.folder)

    def require_playable(self, *, free_bytes: int | None = None) -> None:
        """Refuse a schedule that must not be started.

        Parameters
        ----------
        free_bytes : int, optional
            Free bytes on the disk of the recordings; not checked if not given.

        Raises
        ------
        InputError
            The damage is more than planned, or the disk has too little space for the recording.
        """
        try:
            require_within_plan(self.forecast, self.schedule)
            if free_bytes is not None:
                require_room(self.forecast, free_bytes)
        except ScheduleError as error:
            raise InputError(str(error)) from error

    def __str__(self) -> str:
        """Return events, channels and sums as text."""
        tables = [text_table(_EVENTS, self._event_rows(), left=1)]
        if self.planned:
            tables.append(text_table(_CHANNELS, self._channel_rows(), left=1))
        return "\n\n".join([*tables, "\n".join(self._sums())])

    def _repr_html_(self) -> str:
        tables = [html_table(_EVENTS, self._event_rows(), left=1)]
        if self.planned:
            tables.append(html_table(_CHANNELS, self._channel_rows(), left=1))
        return "".join([*tables, *(f"<p>{line}</p>" for line in self._sums())])

    def _event_rows(self) -> list[tuple[str, ...]]:
        found = self.forecast
        return [
            (name, str(found.repeats[name]), f"{event.load.seconds:.4g} s", str(found.kept[name]), event.source)
            for name, event in self.events.items()
        ]

    def _channel_rows(self) -> list[tuple[str, ...]]:
        damage, ratio = self.forecast.damage, self.forecast.ratio
        return [
            (name, f"{planned:.3g}", f"{damage.get(name, 0.0):.3g}", f"{ratio[name]:.3f}")
            for name, planned in self.planned.items()
        ]

    def _sums(self) -> list[str]:
        found = self.forecast
        lines = [
            f"{sum(found.repeats.values())} repeats in {timedelta(seconds=round(found.seconds))} of playing, without "
            "the rig's ways in and out.",
            f"{in_bytes(found.bytes)} on disk before compression: {in_bytes(found.sample_bytes)} of "
            f"{sum(found.kept.values())} repeats with all samples, {in_bytes(found.statistics_bytes)} of statistics; "
            "repeats around alarms come on top.",
        ]
        if self.planned:
            lines += [
                "Planned damage: all repeats, each with the damage of the response measured in its campaign; of its "
                "target where the drive is a file.",
                f"Planned damage over the damage plan differs from 1 by {self.misfit:.3f} RMS over {len(self.planned)} "
                "channels.",
            ]
        return [*lines, *self.notes]


def load_schedule(path: str | Path) -> Schedule:
    """Read a schedule file.

    Parameters
    ----------
    path : str or Path
        Path of the YAML file.

    Returns
    -------
    Schedule
        Checked schedule; its relative paths start in the folder of the file.

    Raises
    ------
    InputError
        The file cannot be read, or a value is not allowed.
    """
    require_path(path, of="a schedule file", field="path")
    try:
        return read_schedule(Path(path))
    except ScheduleError as error:
        raise InputError(str(error)) from error


def forecast_schedule(schedule: Schedule, *, recordings: Path | None = None) -> ScheduleForecast:
    """Forecast duration, damage and bytes on disk of a schedule.

    Parameters
    ----------
    schedule : Schedule
        Schedule with the repeats of every event.
    recordings : Path, optional
        Folder of a recorder, for events that name a recording by its id.

    Returns
    -------
    ScheduleForecast
        Totals of the schedule; `require_playable` checks that it may be started.

    Raises
    ------
    InputError
        A drive or target cannot be read, a recording missed its target, or repeats are missing.
    """
    events = prepare_events(schedule, recordings=recordings)
    planned, notes = _damage_plan(schedule, events)
    return _with_forecast(schedule, events, planned, notes)


def design_schedule(schedule: Schedule, *, recordings: Path | None = None) -> ScheduleForecast:
    """Choose the repeats of the events without repeats, so that the damage of all channels meets the plan.

    Parameters
    ----------
    schedule : Schedule
        Schedule with a plan; given repeats are unchanged.
    recordings : Path, optional
        Folder of a recorder, for events that name a recording by its id.

    Returns
    -------
    ScheduleForecast
        Designed schedule and its totals, with the damage ratio of each channel.

    Raises
    ------
    InputError
        No event is left to design, or the plan, a drive, a target or a damage is missing.
    """
    if schedule.plan is None:
        raise InputError("The schedule has no plan; give plan.damage or plan.mix.", field="plan")
    if schedule.order is Order.NESTED:
        raise InputError("The order is nested, and blocks set the repeats; design another order.", field="order")
    if all(event.repeats is not None for event in schedule.events.values()):
        raise InputError("Every event has repeats; leave repeats out where they are to be designed.", field="events")
    events = prepare_events(schedule, recordings=recordings)
    planned, notes = _damage_plan(schedule, events)
    damage = {name: event.load.damage for name, event in events.items()}
    if unknown := [name for name, value in damage.items() if value is None]:
        raise InputError(
            f"The damage of {', '.join(unknown)} is not known; give a recording as the drive, or a target.",
            field=f"events.{unknown[0]}",
        )
    if idle := [channel for channel in planned if not any((each or {}).get(channel) for each in damage.values())]:
        raise InputError(
            f"No event damages {', '.join(idle)}; leave it out of the plan, or add an event that does.", field="plan"
        )
    given = schedule.events.values()
    try:
        found = design(
            [[(each or {}).get(channel, 0.0) for channel in planned] for each in damage.values()],
            list(planned.values()),
            at_least=[event.at_least if event.repeats is None else event.repeats for event in given],
            at_most=[
                (MOST_REPEATS if event.at_most is None else event.at_most) if event.repeats is None else event.repeats
                for event in given
            ],
        )
        designed = schedule.with_repeats(dict(zip(events, map(int, found.repeats), strict=True)))
    except ValueError as error:  # of the design, or of the schedule that it gives
        sentence = str(error) if isinstance(error, ScheduleError) else f"The design of {schedule.name}: {error}"
        raise InputError(sentence) from error
    return _with_forecast(designed, events, planned, notes)


def _with_forecast(
    schedule: Schedule, events: dict[str, PreparedEvent], planned: dict[str, float], notes: tuple[str, ...]
) -> ScheduleForecast:
    try:
        found = forecast(schedule, {name: event.load for name, event in events.items()}, planned=planned)
    except ScheduleError as error:
        raise InputError(str(error)) from error
    if found.unknown_damage:
        notes = (*notes, f"The damage of {', '.join(found.unknown_damage)} is not known and not counted.")
    learnt = schedule.monitoring.baseline_repeats
    if unwatched := [f"{name} ({count})" for name, count in found.repeats.items() if 0 < count <= learnt]:
        notes = (
            *notes,
            f"The baseline of an event is learnt from its first {learnt} repeats (monitoring.baseline_repeats); "
            f"{', '.join(unwatched)} has no more, so no change is detected in it.",
        )
    return ScheduleForecast(schedule, events, planned, found, notes)


def _damage_plan(schedule: Schedule, events: Mapping[str, PreparedEvent]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the damage plan of each channel, and notes on channels outside the plan."""
    plan = schedule.plan
    if plan is None:
        return {}, ()
    responses = _responses(events)
    if plan.damage is not None:
        if unknown := [name for name in plan.damage if responses and name not in responses]:
            raise InputError(
                f"plan.damage names {', '.join(unknown)}; the responses are {', '.join(responses)}.",
                field="plan.damage",
            )
        return dict(plan.damage), ()
    planned: dict[str, float] = {}
    notes: list[str] = []
    for name, met in (plan.mix or {}).items():
        target = events[name].target if met.target is None else signals_in_si(schedule.folder / met.target)
        if target is None:
            raise InputError(
                f"plan.mix.{name} has no target, and its event's drive is a file; give the target of one of them.",
                field=f"plan.mix.{name}",
            )
        for event_name, event in events.items():
            require_same_units(target, event.measured, what=f"the target of plan.mix.{name}", than=event_name)
        if met.target is not None and (left_out := left_out_of(target, of=f" of {met.target}")):
            notes.append(f"plan.mix.{name}: {left_out}.")
        damage = damage_of(target, float(schedule.monitoring.damage_exponent))
        if missing := [channel for channel in responses if channel not in damage]:
            raise InputError(
                f"The target of plan.mix.{name} has no channel {', '.join(missing)}; it has {', '.join(damage)}; "
                "give one with all responses.",
                field=f"plan.mix.{name}",
            )
        for channel in responses:
            planned[channel] = planned.get(channel, 0.0) + met.count * damage[channel]
    if silent := [channel for channel, value in planned.items() if value == 0.0]:
        notes.append(f"The customer's mix does not damage {', '.join(silent)}: not planned.")
    return {channel: value for channel, value in planned.items() if value > 0.0}, tuple(notes)


def _responses(events: Mapping[str, PreparedEvent]) -> tuple[str, ...]:
    """Return the names of the responses, from the first event with a response or target."""
    return next((event.measured.names for event in events.values() if event.measured is not None), ())
