"""An endurance test that was checked against its rig before any motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from duralab_bus import FaultError
from duralab_monitoring import Monitor
from duralab_proto.arrays import ArrayError, from_array, from_record
from duralab_proto.keys import check_id, check_rig
from duralab_proto.v1 import query_pb2, rig_pb2, sequencer_pb2
from duralab_schedules import Schedule, ScheduleError
from duralab_settings import YamlError, explain_validation, parse_yaml
from sequencer.endurance.test_log import LONGEST_ID
from sequencer.tally import EventTally

_MOST_HELD_BYTES: Final = 512 * 1024 * 1024


@dataclass(frozen=True)
class EndurancePlan:
    """A checked endurance test.

    `sequence`, shape (repeats,): Index of the event of each repeat. `drives`: Drive of each event, shape (drives,
    samples), as specified. `planned_damage`: Damage of each event, shape (responses,), None if it is not known.
    """

    spec: sequencer_pb2.EnduranceSpec
    description: rig_pb2.RigDescription
    schedule: Schedule
    sequence: NDArray[np.int32]
    drives: tuple[NDArray[np.float64], ...]
    planned_damage: tuple[NDArray[np.float64] | None, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the events."""
        return tuple(self.schedule.events)

    @property
    def responses(self) -> list[str]:
        """Names of the responses."""
        return [channel.name for channel in self.description.responses]

    def fresh_tallies(self) -> list[EventTally]:
        """Return the tallies of a test without any repeat."""
        counts = np.bincount(self.sequence, minlength=len(self.drives))
        size = len(self.description.responses)
        return [
            EventTally.begun(int(count), planned, responses=size)
            for count, planned in zip(counts, self.planned_damage, strict=True)
        ]

    def fresh_monitor(self) -> Monitor:
        """Return a monitor without any judged repeat; raises FaultError if the settings do not fit the rig."""
        try:
            return Monitor(
                self.schedule.monitoring,
                self.names,
                channels=self.responses,
                sample_rate=self.description.sample_rate,
            )
        except ValueError as error:
            raise invalid(str(error), field="schedule") from error

    def restored_monitor(self, state: bytes, baselines: Sequence[bytes]) -> Monitor:
        """Return the monitor with a stored state."""
        if not state:
            return self.fresh_monitor()
        try:
            return Monitor.restored(
                self.schedule.monitoring,
                self.names,
                channels=self.responses,
                sample_rate=self.description.sample_rate,
                state=state,
                baselines=dict(zip(self.names, baselines, strict=True)),
            )
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_DATA_LOSS, str(error), field="id") from error


def invalid(message: str, *, field: str) -> FaultError:
    """Return the fault for a value that is not allowed."""
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)


def require_names(spec: sequencer_pb2.EnduranceSpec) -> None:
    """Refuse an id or a rig that the contract does not allow, or an id that leaves no room for its runs."""
    for check, name, field in ((check_id, spec.id, "id"), (check_rig, spec.rig, "rig")):
        try:
            check(name)
        except ValueError as error:
            raise invalid(str(error), field=field) from error
    if len(spec.id) > LONGEST_ID:
        raise invalid(
            f"The id {spec.id[:20]!r}… has {len(spec.id)} characters; an endurance test's has at most {LONGEST_ID}, "
            "because its runs have longer names: choose a shorter one.",
            field="id",
        )


def plan_endurance(spec: sequencer_pb2.EnduranceSpec, description: rig_pb2.RigDescription) -> EndurancePlan:
    """Check an untrusted endurance test against its rig."""
    schedule = _schedule(spec)
    if schedule.rig != spec.rig:
        raise invalid(f"The schedule is for the rig {schedule.rig!r}, not for {spec.rig!r}.", field="rig")
    given = [event.name for event in spec.events]
    if given != list(schedule.events):
        raise invalid(
            f"The drives are those of {', '.join(given) or 'no event'}; the schedule has "
            f"{', '.join(schedule.events)}: give the drive of each event, in this order.",
            field="events",
        )
    drives = tuple(
        _checked_drive(event, description, field=f"events[{number}].drive") for number, event in enumerate(spec.events)
    )
    plan = EndurancePlan(
        spec=spec,
        description=description,
        schedule=schedule,
        sequence=schedule.sequence().astype(np.int32),
        drives=drives,
        planned_damage=tuple(
            _planned_damage(event, description, field=f"events[{number}].planned_damage")
            for number, event in enumerate(spec.events)
        ),
    )
    _require_room_for_held(plan)
    _require_bands(plan)
    return plan


def _schedule(spec: sequencer_pb2.EnduranceSpec) -> Schedule:
    try:
        schedule = Schedule.model_validate(parse_yaml(spec.schedule))
        schedule.total_repeats  # noqa: B018 - the repeats of each event are needed, a design comes before
    except YamlError as error:
        raise invalid(f"The schedule is not YAML: {error}.", field="schedule") from error
    except ValidationError as error:
        raise invalid(explain_validation(error, Schedule).sentence, field="schedule") from error
    except ScheduleError as error:
        raise invalid(str(error), field="schedule") from error
    return schedule


def _checked_drive(
    event: sequencer_pb2.ScheduledEvent, description: rig_pb2.RigDescription, *, field: str
) -> NDArray[np.float64]:
    """Return the drive of an event, which has the channels and the rate of the rig and is within its limits.

    The rule is that of the rig, which checks each drive once more. The step from rest to the first sample is left to
    it: only the rig knows whether it ramps there.
    """
    named = f"The drive of event {event.name!r}"
    try:
        channels, rate, drive = from_record(event.drive, field=field)
    except ArrayError as error:
        raise invalid(str(error), field=field) from error
    wanted = [(channel.name, channel.unit) for channel in description.drives]
    if [(channel.name, channel.unit) for channel in channels] != wanted or rate != description.sample_rate:
        raise invalid(
            f"{named} has {', '.join(f'{each.name} [{each.unit}]' for each in channels)} at {rate:g} Hz; "
            f"the rig plays {', '.join(f'{name} [{unit}]' for name, unit in wanted)} at "
            f"{description.sample_rate:g} Hz: give a drive of this rig.",
            field=field,
        )
    seconds = drive.shape[1] / rate
    if not 0.0 < seconds <= description.longest_drive_seconds:
        raise invalid(
            f"{named} lasts {seconds:g} s; the rig plays more than 0 and up to "
            f"{description.longest_drive_seconds:g} s: give another one.",
            field=field,
        )
    for channel, row in zip(description.drives, drive, strict=True):
        if row.min() < channel.minimum or row.max() > channel.maximum:
            raise invalid(
                f"{named} goes from {row.min():g} to {row.max():g} {channel.unit} in "
                f"{channel.name}; the rig allows {channel.minimum:g} to {channel.maximum:g}: make a smaller one.",
                field=field,
            )
        slew = np.abs(np.diff(row)) * rate
        if channel.slew_limit > 0.0 and slew.size and slew.max() > channel.slew_limit:
            fastest = int(np.argmax(slew)) + 1
            raise invalid(
                f"{named} moves at {slew.max():.3g} {channel.unit}/s in {channel.name} at "
                f"{fastest / rate:.3f} s; the rig allows {channel.slew_limit:g}: make a slower one.",
                field=field,
            )
    return drive


def _planned_damage(
    event: sequencer_pb2.ScheduledEvent, description: rig_pb2.RigDescription, *, field: str
) -> NDArray[np.float64] | None:
    if not event.HasField("planned_damage"):
        return None
    shape = (len(description.responses),)
    try:
        damage = from_array(event.planned_damage, field=field, shape=shape, dtype=np.float64)
    except ArrayError as error:
        raise invalid(str(error), field=field) from error
    if np.any(damage < 0.0):
        raise invalid(f"{field} is {damage.min():g} at one response; damage is 0 or more.", field=field)
    return damage


def _require_room_for_held(plan: EndurancePlan) -> None:
    held = plan.schedule.keep.around_alarm + 1
    longest = max(drive.shape[1] for drive in plan.drives)
    size = 8 * held * longest * len(plan.description.responses)
    if size > _MOST_HELD_BYTES:
        raise invalid(
            f"keep.around_alarm is {held - 1}, for which {size >> 20} MiB of responses are held in memory; "
            f"{_MOST_HELD_BYTES >> 20} MiB are allowed: give a smaller number.",
            field="schedule",
        )


def _require_bands(plan: EndurancePlan) -> None:
    """Refuse bands that need a longer event; the monitor reports that at its first repeat."""
    monitor = plan.fresh_monitor()
    for name, drive in zip(plan.names, plan.drives, strict=True):
        silent = np.zeros((len(plan.description.responses), drive.shape[1]))
        try:
            monitor.judge(0, name, response=silent)
        except ValueError as error:
            raise invalid(f"Event {name}: {error}", field="schedule") from error
