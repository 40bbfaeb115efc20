"""Updates: each makes the next drive from the model and the playbacks so far."""

from iterator.updates.adaptive_modelling import FEWEST_BLOCKS, corrected, estimate_correction
from iterator.updates.basic_twr import StepStart, step_start
from iterator.updates.by_kind import UPDATES, chosen_update
from iterator.updates.convergence_prediction import ConvergencePrediction, predict_convergence
from iterator.updates.known_before import learned_before
from iterator.updates.plugins import plugin_update
from iterator.updates.rate_limits import stated_rate_limits
from iterator.updates.segment_acceptance import AcceptanceSettings, AcceptedIterate, accept_segments
from iterator.updates.settings import (
    NextDrive,
    Update,
    UpdateSettings,
    own_update,
)
from iterator.updates.watched_responses import controlled_model, controlled_responses, controlled_settings, whole_model

__all__ = [
    "FEWEST_BLOCKS",
    "UPDATES",
    "AcceptanceSettings",
    "AcceptedIterate",
    "ConvergencePrediction",
    "NextDrive",
    "StepStart",
    "Update",
    "UpdateSettings",
    "accept_segments",
    "chosen_update",
    "controlled_model",
    "controlled_responses",
    "controlled_settings",
    "corrected",
    "estimate_correction",
    "learned_before",
    "own_update",
    "plugin_update",
    "predict_convergence",
    "stated_rate_limits",
    "step_start",
    "whole_model",
]
