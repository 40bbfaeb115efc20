"""What a specimen's YAML may hold, the limits and ramps in it, and the specimens that ship with the project."""

from rig_sim.specimen.documents import SpecimenError, document_files, read_document
from rig_sim.specimen.quantities import Quantity
from rig_sim.specimen.responses import ResponseChannel
from rig_sim.specimen.specimen import (
    InputChannel,
    Specimen,
    load_specimen,
    mirrored_name,
    read_specimen,
    shipped_specimens,
)
from rig_sim.specimen.watchdogs import WatchdogLimits, set_up_watchdogs

__all__ = [
    "InputChannel",
    "Quantity",
    "ResponseChannel",
    "Specimen",
    "SpecimenError",
    "WatchdogLimits",
    "document_files",
    "load_specimen",
    "mirrored_name",
    "read_document",
    "read_specimen",
    "set_up_watchdogs",
    "shipped_specimens",
]
