"""Conversion of tallies, statistics and alarms to messages, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_monitoring import Alarm, AlarmKind, AlarmLevel, MonitoringSettings, RepeatStatistics, Statistic
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import sequencer_pb2
from duralab_schedules import AlarmAction
from sequencer.tally import EventTally, correction_damage, planned_damage, total_damage

_ACTIONS: Final = {
    AlarmAction.LOG: sequencer_pb2.ALARM_ACTION_LOG,
    AlarmAction.HOLD: sequencer_pb2.ALARM_ACTION_HOLD,
    AlarmAction.STOP: sequencer_pb2.ALARM_ACTION_STOP,
    AlarmAction.ITERATE_AGAIN: sequencer_pb2.ALARM_ACTION_ITERATE_AGAIN,
}
_LEVELS: Final = {
    AlarmLevel.WARNING: sequencer_pb2.ALARM_LEVEL_WARNING,
    AlarmLevel.ABORT: sequencer_pb2.ALARM_LEVEL_ABORT,
}
_KINDS: Final = {
    AlarmKind.LIMIT: sequencer_pb2.ALARM_KIND_LIMIT,
    AlarmKind.SUDDEN_CHANGE: sequencer_pb2.ALARM_KIND_SUDDEN_CHANGE,
    AlarmKind.SLOW_DRIFT: sequencer_pb2.ALARM_KIND_SLOW_DRIFT,
}


def column_names(settings: MonitoringSettings) -> list[str]:
    """Return the names of the columns of the statistics: the statistics, then the residual of each part."""
    bands = zip(settings.bands, settings.bands[1:], strict=False)
    residuals = ("residual static", *(f"residual {low:g} to {high:g} Hz" for low, high in bands))
    return [*(statistic.value for statistic in Statistic), *residuals]


def put_statistics(statistics: RepeatStatistics, into: sequencer_pb2.EnduranceRepeat) -> None:
    """Set the statistics of a repeat in its step, columns as in `column_names`."""
    into.statistics.CopyFrom(to_array(np.concatenate([statistics.table, statistics.residual], axis=1)))
    into.measures.CopyFrom(to_array(statistics.measures))
    into.lag = 0.0 if np.isnan(statistics.lag) else statistics.lag


def stored_statistics(repeat: sequencer_pb2.EnduranceRepeat, *, responses: int) -> RepeatStatistics:
    """Return the statistics of a step."""
    table, measures = (
        from_array(array, field=name, shape=(responses, None), dtype=np.float64, finite=False)
        for name, array in (("statistics", repeat.statistics), ("measures", repeat.measures))
    )
    lag = np.nan if np.isnan(measures).any() else repeat.lag
    return RepeatStatistics(table=table[:, : len(Statistic)], measures=measures, lag=lag)


def alarm_message(alarm: Alarm, *, event: int, action: AlarmAction, found: int) -> sequencer_pb2.EnduranceAlarm:
    """Return an alarm with its action; `found`: Time in nanoseconds since 1970 UTC."""
    lowest, highest = alarm.band or (0.0, 0.0)
    return sequencer_pb2.EnduranceAlarm(
        repeat=alarm.repeat,
        event=event,
        level=_LEVELS[alarm.level],
        kind=_KINDS[alarm.kind],
        channel=alarm.channel,
        lowest_frequency=lowest,
        highest_frequency=highest,
        since_repeat=alarm.since,
        sentence=alarm.sentence,
        action=_ACTIONS[action],
        measure=alarm.measure.value,
        size=alarm.size,
        found=found,
    )


def event_progress(name: str, tally: EventTally) -> sequencer_pb2.EventProgress:
    """Return the progress of an event."""
    return sequencer_pb2.EventProgress(
        name=name,
        planned=tally.planned,
        played=tally.played,
        unknown=tally.unknown,
        damage=to_array(tally.damage),
        measured=tally.measured,
        measured_damage=to_array(tally.measured_damage),
        drive=tally.drive,
        correction_playbacks=tally.correction_playbacks,
        correction_damage=to_array(tally.correction_damage),
    )


def restored_tally(
    message: sequencer_pb2.EventProgress, planned_damage: NDArray[np.float64] | None, *, responses: int
) -> EventTally:
    """Return the tally of an event from a recording; recordings of before `correction_damage` count none."""
    damage, measured = (
        from_array(array, field="damage", shape=(responses,), dtype=np.float64)
        for array in (message.damage, message.measured_damage)
    )
    corrections = np.zeros(responses)
    if message.HasField("correction_damage"):
        corrections = from_array(
            message.correction_damage, field="correction_damage", shape=(responses,), dtype=np.float64
        )
    return EventTally(
        planned=message.planned,
        planned_damage=planned_damage,
        damage=damage,
        measured_damage=measured,
        correction_damage=corrections,
        correction_playbacks=message.correction_playbacks,
        played=message.played,
        unknown=message.unknown,
        measured=message.measured,
        drive=message.drive,
    )


def progress_of_events(names: Sequence[str], tallies: Sequence[EventTally]) -> list[sequencer_pb2.EventProgress]:
    """Return the progress of all events."""
    return [event_progress(name, tally) for name, tally in zip(names, tallies, strict=True)]


def put_damage(tallies: Sequence[EventTally], into: sequencer_pb2.EnduranceStatus) -> None:
    """Set the damage in a status: counted, the part of corrections, and planned if that is known of every event."""
    into.damage.CopyFrom(to_array(total_damage(tallies)))
    into.correction_playbacks = sum(tally.correction_playbacks for tally in tallies)
    into.correction_damage.CopyFrom(to_array(correction_damage(tallies)))
    for name, whole in (("damage_planned_so_far", False), ("damage_planned", True)):
        planned = planned_damage(tallies, whole=whole)
        into.ClearField(name)
        if planned is not None:
            getattr(into, name).CopyFrom(to_array(planned))
