"""Messages of the service on the bus: requests as settings, a rig's playback, and answers of models to queries."""

from identifier.bus.level_queries import level_series
from identifier.bus.model_queries import advise, converge, difference, drive_room, predict
from identifier.bus.request import settings_of
from identifier.bus.rig_playback import describe_rig, play_experiment
from identifier.bus.shape_request import shape_from

__all__ = [
    "advise",
    "converge",
    "describe_rig",
    "difference",
    "drive_room",
    "level_series",
    "play_experiment",
    "predict",
    "settings_of",
    "shape_from",
]
