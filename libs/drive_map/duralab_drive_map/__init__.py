"""Learned drive map: a triangular change of drive coordinates after which a rig with arcs is nearly linear.

`learn_drive_map` chooses the terms from one record, `DriveMap` applies them forward and backward. A pure core; the
converter to and from messages has its own face, `duralab_drive_map.messages`.
"""

from duralab_drive_map.drive_map import Adjust, DriveMap
from duralab_drive_map.frf_model import FrfModel
from duralab_drive_map.learning import ChosenTerm, LearnedDriveMap, learn_drive_map
from duralab_drive_map.map_terms import MapTerm

__all__ = ["Adjust", "ChosenTerm", "DriveMap", "FrfModel", "LearnedDriveMap", "MapTerm", "learn_drive_map"]
