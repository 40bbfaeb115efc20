"""Time Waveform Replication and Adaptive Modelling: a pure core for notebooks, and the service around it.

The core takes and returns numpy arrays: `control_band` → `rig_model` → `run_campaign(play, target, …)`, where `play`
is any function from a drive to a response. The service (`python -m iterator --config FILE`) plays on a rig of the bus.
"""

from iterator.adaptive_modelling import corrected, estimate_correction
from iterator.applied_model import apply_inverse, predict
from iterator.basic_twr import StepStart, step_start
from iterator.control_band import ControlBand, control_band
from iterator.convergence_prediction import ConvergencePrediction, predict_convergence
from iterator.drive_limits import (
    DriveLimitError,
    DriveLimits,
    DriveOverrunError,
    LimitPolicy,
    LimitQuantity,
    LimitViolation,
    require_within_limits,
)
from iterator.drive_projection import DriveProjection, LimitPassing, project_drive
from iterator.drive_update import (
    CorrectionSettings,
    CorrectionShape,
    NextDrive,
    Prediction,
    SecantSettings,
    Update,
    UpdateKind,
    UpdateSettings,
)
from iterator.gains import GainCurve
from iterator.iteration_history import IterationHistory, Playback
from iterator.iteration_loop import (
    UPDATES,
    CampaignResult,
    CampaignSettings,
    Iteration,
    Play,
    RecordedPlayback,
    iterate,
    run_campaign,
)
from iterator.iteration_metrics import IterationMetrics, best_iteration, judge_response
from iterator.outside_band import OutsideBand, energy_outside_band
from iterator.playback_bounds import NO_BOUNDS, BoundedQuantity, PassedBound, PlaybackBoundError, PlaybackBounds
from iterator.repeatability import Repeatability, judge_repeatability
from iterator.rig_model import ModelUncertainty, RigModel, rig_model
from iterator.segment_acceptance import AcceptanceSettings, AcceptedIterate, accept_segments
from iterator.spectrum_overlay import SpectrumOverlay, overlay_spectra
from iterator.standstill import Standstill, standstills
from iterator.stop_criteria import DamageBounds, Outcome, StopCriteria, damage_spent, judge_end
from iterator.time_segments import Segment, segments_of
from iterator.unreachable_segments import UnreachableSegment, unreachable_segments

__all__ = [
    "NO_BOUNDS",
    "UPDATES",
    "AcceptanceSettings",
    "AcceptedIterate",
    "BoundedQuantity",
    "CampaignResult",
    "CampaignSettings",
    "ControlBand",
    "ConvergencePrediction",
    "CorrectionSettings",
    "CorrectionShape",
    "DamageBounds",
    "DriveLimitError",
    "DriveLimits",
    "DriveOverrunError",
    "DriveProjection",
    "GainCurve",
    "Iteration",
    "IterationHistory",
    "IterationMetrics",
    "LimitPassing",
    "LimitPolicy",
    "LimitQuantity",
    "LimitViolation",
    "ModelUncertainty",
    "NextDrive",
    "Outcome",
    "OutsideBand",
    "PassedBound",
    "Play",
    "Playback",
    "PlaybackBoundError",
    "PlaybackBounds",
    "Prediction",
    "RecordedPlayback",
    "Repeatability",
    "RigModel",
    "SecantSettings",
    "Segment",
    "SpectrumOverlay",
    "Standstill",
    "StepStart",
    "StopCriteria",
    "UnreachableSegment",
    "Update",
    "UpdateKind",
    "UpdateSettings",
    "accept_segments",
    "apply_inverse",
    "best_iteration",
    "control_band",
    "corrected",
    "damage_spent",
    "energy_outside_band",
    "estimate_correction",
    "iterate",
    "judge_end",
    "judge_repeatability",
    "judge_response",
    "overlay_spectra",
    "predict",
    "predict_convergence",
    "project_drive",
    "require_within_limits",
    "rig_model",
    "run_campaign",
    "segments_of",
    "standstills",
    "step_start",
    "unreachable_segments",
]
