"""Model of the rig in the frequency domain: its inverse, both applied to records, and the playbacks that correct it."""

from iterator.model.applied_model import apply_inverse, drive_without, predict, stepped_drive
from iterator.model.drive_terms import ODD_TERMS, SPEED_TERMS, DriveTerm, speed_of_lines
from iterator.model.history import IterationHistory, Playback
from iterator.model.interpolated_product import InterpolatedMatrix
from iterator.model.inversion import cautious_inverse, checked_response_weight, gram_and_ridge
from iterator.model.rate_limit import RateLimit, equivalent_drive
from iterator.model.rig import FEWEST_LINES, ModelUncertainty, RigModel, driven_lines, rig_model
from iterator.model.step_spectra import ForeseenStep, SeenStep, StepBlocks, StepSpectra, averaged_steps, seen_steps
from iterator.model.whole_records import WholeRecords

__all__ = [
    "FEWEST_LINES",
    "ODD_TERMS",
    "SPEED_TERMS",
    "DriveTerm",
    "ForeseenStep",
    "InterpolatedMatrix",
    "IterationHistory",
    "ModelUncertainty",
    "Playback",
    "RateLimit",
    "RigModel",
    "SeenStep",
    "StepBlocks",
    "StepSpectra",
    "WholeRecords",
    "apply_inverse",
    "averaged_steps",
    "cautious_inverse",
    "checked_response_weight",
    "drive_without",
    "driven_lines",
    "equivalent_drive",
    "gram_and_ridge",
    "predict",
    "rig_model",
    "seen_steps",
    "speed_of_lines",
    "stepped_drive",
]
