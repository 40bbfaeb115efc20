"""Schedules of endurance tests: read their events from drives and recordings, design and forecast them."""

from duralab.schedule.events import PreparedEvent, prepare_events
from duralab.schedule.planning import ScheduleForecast, design_schedule, forecast_schedule, load_schedule
from duralab.schedule.writing import schedule_text

__all__ = [
    "PreparedEvent",
    "ScheduleForecast",
    "design_schedule",
    "forecast_schedule",
    "load_schedule",
    "prepare_events",
    "schedule_text",
]
