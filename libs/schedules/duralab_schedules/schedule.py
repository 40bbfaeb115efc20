"""Schedule file: events with drives and repeats, the order, the damage plan, and the samples that are kept."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from duralab_monitoring import MonitoringSettings
from duralab_schedules.order import Order, in_order, interleaved, nested, shuffled
from duralab_settings import Positive, Section, Seed, YamlError, explain_validation, parse_yaml, read_yaml_text

MOST_REPEATS: Final = 10_000_000
"""Largest number of repeats of one schedule, all events together: their order is held in memory."""

EventName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,59}$")]
Repeats = Annotated[int, Field(ge=0, le=MOST_REPEATS)]


class ScheduleError(ValueError):
    """Schedule that cannot be read, designed or played.

    Parameters
    ----------
    sentence : str
        One sentence: the wrong value, the allowed values and the remedy.
    path : Path, optional
        Path of the schedule file.
    """

    def __init__(self, sentence: str, *, path: Path | None = None) -> None:
        super().__init__(sentence if path is None else f"{path}: {sentence}")
        self.sentence = sentence
        self.path = path


class Event(Section):
    """Target of a schedule with its drive."""

    drive: str = Field(
        min_length=1, description="Drive: a file or a recording, relative to the schedule, or the id of a recording."
    )
    repeats: Repeats | None = Field(
        default=None, description="Number of repeats; left out: designed from the damage plan, or set by blocks."
    )
    at_least: Repeats = Field(default=0, description="Smallest number of repeats that a design may choose.")
    at_most: Repeats | None = Field(default=None, description="Largest number of repeats that a design may choose.")
    missed_target_accepted: bool = Field(
        default=False, description="Play the drive also if its recording missed the target."
    )
    target: str | None = Field(
        default=None,
        min_length=1,
        description="Target file of a drive that is not from a recording: its damage is that of one repeat.",
    )

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        if self.at_most is not None and self.at_most < self.at_least:
            raise ValueError(f"at_least is {self.at_least} and at_most {self.at_most}; at_least must not be above")
        highest = MOST_REPEATS if self.at_most is None else self.at_most
        if self.repeats is not None and not self.at_least <= self.repeats <= highest:
            raise ValueError(
                f"repeats is {self.repeats}, and at_least and at_most allow {self.at_least} to {highest}; leave "
                "repeats out, and the design chooses it"
            )
        return self


class Block(Section):
    """Events of a nested schedule that are played together."""

    times: int = Field(default=1, ge=1, le=MOST_REPEATS, description="Number of repeats of the block.")
    events: dict[EventName, Annotated[int, Field(ge=1, le=MOST_REPEATS)]] = Field(
        min_length=1, description="Repeats of each event in one block, in this order."
    )


class CustomerEvent(Section):
    """Number of times that a customer meets one event."""

    count: Positive = Field(description="Number of times that the customer meets the event.")
    target: str | None = Field(
        default=None,
        min_length=1,
        description="Target file; left out: that of the schedule's event.",
    )


class DamagePlan(Section):
    """Damage that the endurance test must reach in each channel: given, or that of a customer's mix of events."""

    damage: dict[str, Positive] | None = Field(
        default=None,
        min_length=1,
        description="Damage by response, in its unit to the power of monitoring.damage_exponent.",
    )
    mix: dict[EventName, CustomerEvent] | None = Field(
        default=None, min_length=1, description="Number of times that a customer meets each event."
    )
    largest_ratio: Annotated[float, Field(ge=1)] = Field(
        default=1.5,
        description="Largest planned damage of a channel over its damage plan; above it is refused.",
    )

    @model_validator(mode="after")
    def _check_one_way(self) -> Self:
        if (self.damage is None) == (self.mix is None):
            raise ValueError("needs either damage or mix; give one of them")
        return self


class KeepRule(Section):
    """Rule for the repeats that are recorded with all samples; the others keep their statistics only."""

    first: Repeats = Field(default=3, description="Number of first repeats of each event that are kept.")
    every: Annotated[int, Field(ge=1, le=MOST_REPEATS)] | None = Field(
        default=500, description="Every n-th repeat of each event; null: none."
    )
    around_alarm: Annotated[int, Field(ge=0, le=100)] = Field(
        default=2, description="Repeats before and after the one with an alarm, beside that one."
    )

    def keeps(self, nth: int) -> bool:
        """Return whether the samples of a repeat are kept, alarms aside.

        Parameters
        ----------
        nth : int
            Number of the repeat among those of its event, from 0.

        Returns
        -------
        bool
            True for the first ones and every n-th.
        """
        return nth < self.first or (self.every is not None and nth % self.every == 0)


class AlarmAction(StrEnum):
    """Action of the sequencer after an alarm."""

    LOG = "log"
    """The alarm is recorded, and the test continues."""
    HOLD = "hold"
    """The test waits for a decision before the next repeat."""
    STOP = "stop"
    """The test ends, and the rig is latched."""
    ITERATE_AGAIN = "iterate_again"
    """The drive of the event is corrected in a campaign, and the test continues with the new one."""


class Actions(Section):
    """Actions of the sequencer after an alarm of each level."""

    warning: AlarmAction = Field(
        default=AlarmAction.LOG, strict=False, description="After a warning: log, hold, stop or iterate_again."
    )
    abort: AlarmAction = Field(
        default=AlarmAction.HOLD, strict=False, description="After an abort: log, hold, stop or iterate_again."
    )
    playbacks: Annotated[int, Field(ge=1, le=20)] = Field(
        default=3, description="Largest number of playbacks of a campaign of iterate_again."
    )


class Schedule(Section):
    """Content of a schedule file."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,59}$",
        description="Name of the endurance test and its recording: lower case letters, digits, '-' and '_'.",
    )
    rig: str = Field(pattern=r"^[a-z0-9][a-z0-9_]{0,59}$", description="Name of the rig.")
    events: dict[EventName, Event] = Field(min_length=1, description="Events by name.")
    order: Order = Field(
        default=Order.INTERLEAVED, strict=False, description="in_order, interleaved, shuffled or nested."
    )
    seed: Seed = Field(default=0, description="Seed of the shuffled order.")
    blocks: tuple[Block, ...] = Field(
        default=(), strict=False, description="Blocks of a nested schedule, in the order they are played."
    )
    keep: KeepRule = Field(default=KeepRule(), description="Repeats that are recorded with all samples.")
    monitoring: MonitoringSettings = Field(default=MonitoringSettings(), description="Monitoring of the repeats.")
    actions: Actions = Field(default=Actions(), description="Actions after an alarm.")
    plan: DamagePlan | None = Field(default=None, description="Damage that the endurance test is to reach.")

    _folder: Path = PrivateAttr(default=Path())

    @property
    def folder(self) -> Path:
        """Folder at which the relative paths of the file start."""
        return self._folder

    @property
    def repeats(self) -> dict[str, int]:
        """Number of repeats of each event, in the order of the events.

        Raises
        ------
        ScheduleError
            If the repeats of an event are not designed yet.
        """
        if self.order is Order.NESTED:
            return {name: sum(block.times * block.events.get(name, 0) for block in self.blocks) for name in self.events}
        if missing := [name for name, event in self.events.items() if event.repeats is None]:
            raise ScheduleError(
                f"repeats of {', '.join(missing)} is missing; give it, or let `duralab schedule design` choose it."
            )
        return {name: event.repeats or 0 for name, event in self.events.items()}

    @property
    def total_repeats(self) -> int:
        """Number of repeats, all events together."""
        return sum(self.repeats.values())

    def sequence(self) -> NDArray[np.int64]:
        """Return the event of every repeat.

        Returns
        -------
        ndarray, shape (repeats,)
            Index of the event among `events`, 0 or more; the same for the same schedule and seed.

        Raises
        ------
        ScheduleError
            If the repeats of an event are not designed yet.
        """
        repeats = tuple(self.repeats.values())
        match self.order:
            case Order.NESTED:
                index = {name: number for number, name in enumerate(self.events)}
                blocks = [
                    (block.times, [(index[name], count) for name, count in block.events.items()])
                    for block in self.blocks
                ]
                return nested(blocks)
            case Order.INTERLEAVED:
                return interleaved(repeats)
            case Order.SHUFFLED:
                return shuffled(repeats, self.seed)
            case _:
                return in_order(repeats)

    def with_repeats(self, repeats: dict[str, int]) -> Schedule:
        """Return this schedule with other repeats.

        Parameters
        ----------
        repeats : dict of str to int
            Repeats of every event, 0 or more.

        Returns
        -------
        Schedule
            Checked schedule; its relative paths start in the same folder.
        """
        events = {name: event.model_copy(update={"repeats": repeats[name]}) for name, event in self.events.items()}
        changed = Schedule(**{**{name: getattr(self, name) for name in type(self).model_fields}, "events": events})
        return changed.read_from(self.folder)

    def read_from(self, folder: Path) -> Schedule:
        """Return this schedule with the folder at which its relative paths start.

        Parameters
        ----------
        folder : Path
            Folder of the schedule file.

        Returns
        -------
        Schedule
            Copy of the schedule.
        """
        copy = self.model_copy()
        copy._folder = folder  # noqa: SLF001  (private attribute of the same class, on a new copy)
        return copy

    @model_validator(mode="after")
    def _check_events(self) -> Self:
        named = [("blocks", name) for block in self.blocks for name in block.events]
        if self.plan is not None and self.plan.mix is not None:
            named += [("plan.mix", name) for name, met in self.plan.mix.items() if met.target is None]
        for place, name in named:
            if name not in self.events:
                raise ValueError(f"{place} names the unknown event {name!r}; known are {', '.join(self.events)}")
        return self

    @model_validator(mode="after")
    def _check_repeats(self) -> Self:
        if (self.order is Order.NESTED) != bool(self.blocks):
            given = "no blocks" if self.order is Order.NESTED else f"blocks and the order {self.order}"
            raise ValueError(f"the schedule has {given}; blocks belong to the order nested, and it needs them")
        given = [event.repeats for event in self.events.values() if event.repeats is not None]
        if self.order is Order.NESTED:
            if given:
                raise ValueError(
                    "the schedule has repeats of an event beside blocks, which set them; leave repeats out"
                )
            given = list(self.repeats.values())
            if idle := [name for name, count in self.repeats.items() if not count]:
                raise ValueError(f"{', '.join(idle)} is in no block; name it in one, or leave the event out")
        total = sum(given)
        if total > MOST_REPEATS:
            raise ValueError(
                f"the schedule has {total} repeats; {MOST_REPEATS} are allowed, so divide it into several schedules"
            )
        if total == 0 and len(given) == len(self.events):
            raise ValueError("the schedule has no repeats at all; give one event repeats above 0")
        return self


def read_schedule(path: Path) -> Schedule:
    """Read a schedule file.

    Parameters
    ----------
    path : Path
        Path of the YAML file.

    Returns
    -------
    Schedule
        Checked schedule; its relative paths start in the folder of the file.

    Raises
    ------
    ScheduleError
        If the file cannot be read, or a value is not allowed; one sentence.
    """
    try:
        content = parse_yaml(read_yaml_text(path))
        schedule = Schedule.model_validate({} if content is None else content)
    except OSError as error:
        raise ScheduleError(f"it cannot be read ({error.strerror}); give a schedule file.", path=path) from error
    except UnicodeDecodeError as error:
        raise ScheduleError("it is not UTF-8 text.", path=path) from error
    except YamlError as error:
        raise ScheduleError(f"it is not YAML: {error}; correct it there.", path=path) from error
    except ValidationError as error:
        raise ScheduleError(explain_validation(error, Schedule).sentence, path=path) from error
    return schedule.read_from(path.parent)
