"""Monitoring of an endurance test: statistics of every repeat, limits, and detection of wear and cracks.

`Monitor` judges one repeat after the other. It keeps no samples: an event's baseline is the mean spectrum of its first
repeats, and the rest is a few numbers for each channel and band.
"""

from duralab_monitoring.alarms import Alarm, AlarmKind, AlarmLevel, RepeatVerdict
from duralab_monitoring.changes import ChangeWatch
from duralab_monitoring.monitor import Monitor
from duralab_monitoring.repeat_statistics import RepeatStatistics
from duralab_monitoring.residual import Measure
from duralab_monitoring.settings import AbsoluteLimits, Levels, MonitoringSettings, Statistic

__all__ = [
    "AbsoluteLimits",
    "Alarm",
    "AlarmKind",
    "AlarmLevel",
    "ChangeWatch",
    "Levels",
    "Measure",
    "Monitor",
    "MonitoringSettings",
    "RepeatStatistics",
    "RepeatVerdict",
    "Statistic",
]
