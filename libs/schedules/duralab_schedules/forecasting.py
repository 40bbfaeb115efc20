"""Forecast of a schedule: duration, damage, kept repeats, bytes on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from duralab_monitoring import MonitoringSettings, Statistic
from duralab_schedules.schedule import KeepRule, Schedule, ScheduleError

BYTES_PER_SAMPLE: Final = 8
"""Size of a float64 sample; compression is not assumed."""

REPEAT_BYTES: Final = 1100
"""Size in bytes of one repeat, beside the numbers of its responses: two steps with names, hashes, index; measured
are 980."""

BASELINE_BYTES: Final = 16
"""Size in bytes of each line of a baseline and each response: complex."""

_POSES_SHARE: Final = 0.1
# Share of the samples of a repeat, for the poses of a rig with bodies.


@dataclass(frozen=True)
class EventLoad:
    """Samples, channels and damage of one repeat of an event.

    Parameters
    ----------
    samples : int
        Number of samples of its drive.
    sample_rate : float
        Sample rate in Hz.
    drives, responses : int
        Numbers of recorded channels.
    damage : mapping of str to float, optional
        Damage by response; None if unknown.
    """

    samples: int
    sample_rate: float
    drives: int
    responses: int
    damage: Mapping[str, float] | None = None

    @property
    def seconds(self) -> float:
        """Duration without the leads to its first sample and back from the last."""
        return self.samples / self.sample_rate

    @property
    def drive_bytes(self) -> int:
        """Size of its drive in bytes."""
        return self.samples * self.drives * BYTES_PER_SAMPLE

    @property
    def sample_bytes(self) -> int:
        """Size in bytes of one repeat with all samples."""
        return round(self.samples * (self.drives + self.responses) * BYTES_PER_SAMPLE * (1.0 + _POSES_SHARE))


@dataclass(frozen=True)
class Forecast:
    """Forecast of a schedule.

    Parameters
    ----------
    repeats, kept : dict of str to int
        Repeats by event, and those whose samples are kept by the rule, without those around alarms.
    seconds : float
        Duration of all repeats, without the leads.
    damage : dict of str to float
        Planned damage: that of all repeats by response, over the events with known damage.
    unknown_damage : tuple of str
        Events with unknown damage.
    ratio : dict of str to float
        Planned damage over the damage plan by channel of the plan; empty without a plan.
    sample_bytes, statistics_bytes : int
        Sizes on disk, before compression: drives and kept samples; statistics of every repeat and the baselines.
    """

    repeats: dict[str, int]
    kept: dict[str, int]
    seconds: float
    damage: dict[str, float]
    unknown_damage: tuple[str, ...]
    ratio: dict[str, float]
    sample_bytes: int
    statistics_bytes: int

    @property
    def bytes(self) -> int:
        """Size on disk in bytes: kept samples and statistics."""
        return self.sample_bytes + self.statistics_bytes


def forecast(
    schedule: Schedule, loads: Mapping[str, EventLoad], *, planned: Mapping[str, float] | None = None
) -> Forecast:
    """Return the forecast of a schedule.

    Parameters
    ----------
    schedule : Schedule
        Schedule with the repeats of every event.
    loads : mapping of str to EventLoad
        One repeat of each event.
    planned : mapping of str to float, optional
        Damage plan by response, above 0.

    Returns
    -------
    Forecast
        Duration, damage and bytes.

    Raises
    ------
    ScheduleError
        If the repeats of an event are missing.
    """
    repeats = schedule.repeats
    kept = {name: kept_repeats(schedule.keep, count) for name, count in repeats.items()}
    played = [name for name, count in repeats.items() if count]
    known = {name: loads[name].damage or {} for name in played}
    damage: dict[str, float] = {}
    for name, each in known.items():
        for channel, value in each.items():
            damage[channel] = damage.get(channel, 0.0) + repeats[name] * value
    return Forecast(
        repeats=repeats,
        kept=kept,
        seconds=sum(repeats[name] * loads[name].seconds for name in played),
        damage=damage,
        unknown_damage=tuple(name for name in played if loads[name].damage is None),
        ratio={channel: damage.get(channel, 0.0) / value for channel, value in (planned or {}).items()},
        sample_bytes=sum(loads[name].drive_bytes + kept[name] * loads[name].sample_bytes for name in played),
        statistics_bytes=sum(_statistics_bytes(schedule.monitoring, loads[name], repeats[name]) for name in played),
    )


def _statistics_bytes(settings: MonitoringSettings, load: EventLoad, repeats: int) -> int:
    """Return the bytes of the statistics of an event's repeats, and of its baseline while it is learnt."""
    bands = len(settings.bands) - 1
    # Damage; statistics and residual; values that the monitor compared.
    numbers = 1 + len(Statistic) + 1 + bands + 1 + 3 * bands
    lines = settings.bands[-1] * load.seconds
    learning = min(repeats, -(-settings.baseline_repeats // 2))
    baseline = round(lines * load.responses * BASELINE_BYTES)
    return repeats * (REPEAT_BYTES + load.responses * numbers * BYTES_PER_SAMPLE) + learning * baseline


def kept_repeats(rule: KeepRule, repeats: int) -> int:
    """Return the number of repeats of an event that are kept with their samples, without those around alarms."""
    if rule.every is None:
        return min(rule.first, repeats)
    # Of 0, every, 2 every, …: those that are not among the first.
    periodic = (repeats + rule.every - 1) // rule.every - (min(rule.first, repeats) + rule.every - 1) // rule.every
    return min(rule.first, repeats) + periodic


def require_within_plan(expected: Forecast, schedule: Schedule) -> None:
    """Refuse a schedule with more damage than its damage plan.

    Parameters
    ----------
    expected : Forecast
        Forecast of this schedule.
    schedule : Schedule
        Schedule with a plan, or without one, which allows every damage.

    Raises
    ------
    ScheduleError
        If the damage of a channel is above the largest ratio of the plan, with the worst channel, or the damage of an
        event is unknown.
    """
    if schedule.plan is None:
        return
    if expected.unknown_damage:
        raise ScheduleError(
            f"The damage of {', '.join(expected.unknown_damage)} is not known, and the schedule has a plan; give a "
            "recording as the drive, or a target."
        )
    channel, ratio = max(expected.ratio.items(), key=lambda item: item[1])
    if ratio > schedule.plan.largest_ratio:
        raise ScheduleError(
            f"The schedule {schedule.name} puts {ratio:.3g} times the damage of its plan into {channel}, and "
            f"{schedule.plan.largest_ratio:g} is allowed (plan.largest_ratio); design its repeats, or lower them."
        )


def require_room(expected: Forecast, free_bytes: int) -> None:
    """Refuse a schedule whose recording is larger than the free space on the disk.

    Parameters
    ----------
    expected : Forecast
        Forecast of the schedule.
    free_bytes : int
        Free space on the disk of the recordings.

    Raises
    ------
    ScheduleError
        If the forecast is above the free space.
    """
    if expected.bytes > free_bytes:
        raise ScheduleError(
            f"The recording takes {in_bytes(expected.bytes)} and {in_bytes(free_bytes)} are free; keep fewer repeats "
            "(keep.every), or make room."
        )


def in_bytes(count: float) -> str:
    """Return a number of bytes with three digits and its unit.

    Parameters
    ----------
    count : float
        Number of bytes, 0 or more.

    Returns
    -------
    str
        Text, for example "1.25 GB"; powers of 1000.
    """
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.4g} GB"
