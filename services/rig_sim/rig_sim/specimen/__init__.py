"""What a specimen's YAML may hold, the limits and ramps in it, and the specimens that ship with the project."""

from rig_sim.specimen.approach import Approach
from rig_sim.specimen.documents import SpecimenError
from rig_sim.specimen.quantities import Quantity
from rig_sim.specimen.responses import ResponseChannel
from rig_sim.specimen.specimen import InputChannel, Specimen, load_specimen, shipped_specimens
from rig_sim.specimen.watchdogs import WatchdogLimits, WatchdogMonitor

__all__ = [
    "Approach",
    "InputChannel",
    "Quantity",
    "ResponseChannel",
    "Specimen",
    "SpecimenError",
    "WatchdogLimits",
    "WatchdogMonitor",
    "load_specimen",
    "shipped_specimens",
]
