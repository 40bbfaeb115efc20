"""Learned drive map: a triangular change of drive coordinates after which a rig with arcs is nearly linear."""

from iterator.drive_map.drive_map import Adjust, DriveMap
from iterator.drive_map.learning import (
    ChosenTerm,
    EstimateModel,
    LearnedDriveMap,
    learn_drive_map,
)
from iterator.drive_map.map_terms import MapTerm
from iterator.drive_map.mapped_projection import (
    drive_within_limits,
    project_mapped_drive,
    require_rest_within_limits,
    wanted_drive,
)

__all__ = [
    "Adjust",
    "ChosenTerm",
    "DriveMap",
    "EstimateModel",
    "LearnedDriveMap",
    "MapTerm",
    "drive_within_limits",
    "learn_drive_map",
    "project_mapped_drive",
    "require_rest_within_limits",
    "wanted_drive",
]
