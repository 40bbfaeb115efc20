"""What a specimen's YAML may hold, the limits and ramps in it, and the specimens that ship with the project."""

from rig_sim.specimen.responses import (
    AccelerationChannel,
    BushingChannel,
    Quantity,
    ResponseChannel,
    SpindleChannel,
    StrutChannel,
)
from rig_sim.specimen.specimen import (
    AntiRollBarPart,
    InputChannel,
    Name,
    RubberPart,
    Specimen,
    SpecimenError,
    StrutPart,
    TyrePart,
    document_files,
    explain_problems,
    load_specimen,
    mirrored_name,
    read_document,
    read_specimen,
    shipped_specimens,
)
from rig_sim.specimen.watchdogs import WatchdogLimits, set_up_watchdogs

__all__ = [
    "AccelerationChannel",
    "AntiRollBarPart",
    "BushingChannel",
    "InputChannel",
    "Name",
    "Quantity",
    "ResponseChannel",
    "RubberPart",
    "Specimen",
    "SpecimenError",
    "SpindleChannel",
    "StrutChannel",
    "StrutPart",
    "TyrePart",
    "WatchdogLimits",
    "document_files",
    "explain_problems",
    "load_specimen",
    "mirrored_name",
    "read_document",
    "read_specimen",
    "set_up_watchdogs",
    "shipped_specimens",
]
