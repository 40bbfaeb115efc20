"""Schedules of endurance tests: repeats and order of their events.

`read_schedule` reads and checks a file, `Schedule.sequence` returns the order of all repeats, `design` chooses repeats
from damage, `forecast` predicts duration, damage and bytes. A pure core: no bus, no messages.
"""

from duralab_schedules.forecasting import (
    EventLoad,
    Forecast,
    forecast,
    in_bytes,
    require_room,
    require_within_plan,
)
from duralab_schedules.order import Order
from duralab_schedules.repeat_design import Design, design
from duralab_schedules.schedule import (
    MOST_REPEATS,
    Actions,
    AlarmAction,
    Block,
    CustomerEvent,
    DamagePlan,
    Event,
    KeepRule,
    Schedule,
    ScheduleError,
    read_schedule,
)

__all__ = [
    "MOST_REPEATS",
    "Actions",
    "AlarmAction",
    "Block",
    "CustomerEvent",
    "DamagePlan",
    "Design",
    "Event",
    "EventLoad",
    "Forecast",
    "KeepRule",
    "Order",
    "Schedule",
    "ScheduleError",
    "design",
    "forecast",
    "in_bytes",
    "read_schedule",
    "require_room",
    "require_within_plan",
]
