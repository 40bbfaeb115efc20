"""Roads: synthesis after ISO 8608, potholes, OpenCRG files, and the inputs of a tyre to its wheel."""

from duralab_roads.enveloping import EFFECTIVE_INPUTS, effective_inputs
from duralab_roads.iso8608 import RoadClass, iso8608_road, roughness_coefficient, track_coherence
from duralab_roads.opencrg import RoadFileError, read_opencrg
from duralab_roads.potholes import add_potholes
from duralab_roads.road import Road, level, repeat_mirrored

__all__ = [
    "EFFECTIVE_INPUTS",
    "Road",
    "RoadClass",
    "RoadFileError",
    "add_potholes",
    "effective_inputs",
    "iso8608_road",
    "level",
    "read_opencrg",
    "repeat_mirrored",
    "roughness_coefficient",
    "track_coherence",
]
