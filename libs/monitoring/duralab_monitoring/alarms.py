"""Verdict of the monitor on a repeat: statistics, and alarms at two levels."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from duralab_monitoring.repeat_statistics import RepeatStatistics
from duralab_monitoring.residual import Measure
from duralab_monitoring.settings import Statistic


class AlarmLevel(IntEnum):
    """Severity of an alarm."""

    WARNING = 1
    """The test continues according to its actions."""
    ABORT = 2
    """The test must not continue without a decision."""


class AlarmKind(StrEnum):
    """Kind of an alarm."""

    SLOW_DRIFT = "slow_drift"
    """The response moves away from its baseline over many repeats: wear."""
    SUDDEN_CHANGE = "sudden_change"
    """The response changed from one repeat to the next: a crack, a loose bolt."""
    LIMIT = "limit"
    """A statistic is outside its learnt or absolute limits."""


@dataclass(frozen=True)
class Alarm:
    """A change or a statistic that passed a level; raised once until the baseline is learnt again.

    Parameters
    ----------
    level : AlarmLevel
        Warning or abort.
    kind : AlarmKind
        Slow drift, sudden change or limit.
    event : str
        Event that was played when it was found.
    channel : str
        Channel of the response.
    measure : Measure or Statistic
        Changed measure; a statistic for a limit.
    band : tuple of float or None
        Lowest and highest frequency, Hz; None for a limit and for the static part.
    repeat : int
        Repeat of the schedule in which it was found.
    since : int
        Repeat in which it began, as far as it can be determined; `repeat` for a limit.
    size : float
        Change as a share of the baseline; for an absolute limit the value of the statistic.
    sentence : str
        Report as text.
    """

    level: AlarmLevel
    kind: AlarmKind
    event: str
    channel: str
    measure: Measure | Statistic
    band: tuple[float, float] | None
    repeat: int
    since: int
    size: float
    sentence: str


@dataclass(frozen=True)
class RepeatVerdict:
    """Verdict of the monitor on one repeat.

    Parameters
    ----------
    statistics : RepeatStatistics
        Statistics to be kept for every repeat.
    alarms : tuple of Alarm
        New alarms, the most severe first, then changes before limits and large before small ones; at most one change
        for each channel.
    judged : bool
        Whether the event was judged; False while its baseline is learnt, when only absolute limits hold.
    baseline_changed : bool
        Whether `Monitor.baseline` of the event must be stored again with this repeat.
    """

    statistics: RepeatStatistics
    alarms: tuple[Alarm, ...]
    judged: bool
    baseline_changed: bool

    @property
    def level(self) -> AlarmLevel | None:
        """Most severe level of the alarms, None without one."""
        return max((alarm.level for alarm in self.alarms), default=None)
