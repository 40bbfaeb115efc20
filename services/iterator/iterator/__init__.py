"""Time Waveform Replication and Adaptive Modelling: a pure core for notebooks, and the service around it.

The core takes and returns numpy arrays: `control_band` → `rig_model` → `run_campaign(play, target, …)`, where `play`
is any function from a drive to a response. The service (`python -m iterator --config FILE`) plays on a rig of the bus.
"""

from iterator.adaptive_modelling import corrected, estimate_correction
from iterator.control_band import ControlBand, control_band
from iterator.drive_limits import DriveLimitError, DriveLimits, LimitViolation, require_within_limits
from iterator.drive_update import CorrectionSettings, NextDrive, Update, UpdateKind, UpdateSettings
from iterator.iteration_history import IterationHistory, Playback
from iterator.iteration_loop import UPDATES, CampaignResult, CampaignSettings, Iteration, Play, iterate, run_campaign
from iterator.iteration_metrics import IterationMetrics, best_iteration, judge_response
from iterator.rig_model import RigModel, apply_inverse, predict, rig_model
from iterator.stop_criteria import Outcome, StopCriteria, judge_end

__all__ = [
    "UPDATES",
    "CampaignResult",
    "CampaignSettings",
    "ControlBand",
    "CorrectionSettings",
    "DriveLimitError",
    "DriveLimits",
    "Iteration",
    "IterationHistory",
    "IterationMetrics",
    "LimitViolation",
    "NextDrive",
    "Outcome",
    "Play",
    "Playback",
    "RigModel",
    "StopCriteria",
    "Update",
    "UpdateKind",
    "UpdateSettings",
    "apply_inverse",
    "best_iteration",
    "control_band",
    "corrected",
    "estimate_correction",
    "iterate",
    "judge_end",
    "judge_response",
    "predict",
    "require_within_limits",
    "rig_model",
    "run_campaign",
]
