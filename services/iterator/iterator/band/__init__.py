"""Control band: controlled and judged lines, and records limited to them."""

from iterator.band.band import ControlBand, control_band
from iterator.band.lower_rate import LowerRate
from iterator.band.outside_band import OutsideBand, energy_outside_band
from iterator.band.rest import DRIVE_FADE_SECONDS, TARGET_FADE_SECONDS, faded
from iterator.band.time_segments import Segment, segments_of

__all__ = [
    "DRIVE_FADE_SECONDS",
    "TARGET_FADE_SECONDS",
    "ControlBand",
    "LowerRate",
    "OutsideBand",
    "Segment",
    "control_band",
    "energy_outside_band",
    "faded",
    "segments_of",
]
