"""Assessment of playbacks: error figures, spectra, bounds, dead sensors, and when the iteration ends."""

from iterator.assessment.metrics import IterationMetrics, best_iteration, judge_response
from iterator.assessment.playback_bounds import (
    NO_BOUNDS,
    BoundedQuantity,
    PassedBound,
    PlaybackBoundError,
    PlaybackBounds,
)
from iterator.assessment.playback_levels import (
    best_at_full_level,
    comparable_history,
    judge_end_at_levels,
    level_of,
    partial_playbacks,
    require_levels,
)
from iterator.assessment.repeatability import Repeatability, judge_repeatability
from iterator.assessment.spectrum_overlay import SpectrumOverlay, overlay_spectra
from iterator.assessment.standstill import Standstill, standstills
from iterator.assessment.stop_criteria import (
    DamageBounds,
    Outcome,
    StopCriteria,
    damage_spent,
    judge_end,
    passed_bound,
    would_overspend,
)

__all__ = [
    "NO_BOUNDS",
    "BoundedQuantity",
    "DamageBounds",
    "IterationMetrics",
    "Outcome",
    "PassedBound",
    "PlaybackBoundError",
    "PlaybackBounds",
    "Repeatability",
    "SpectrumOverlay",
    "Standstill",
    "StopCriteria",
    "best_at_full_level",
    "best_iteration",
    "comparable_history",
    "damage_spent",
    "judge_end",
    "judge_end_at_levels",
    "judge_repeatability",
    "judge_response",
    "level_of",
    "overlay_spectra",
    "partial_playbacks",
    "passed_bound",
    "require_levels",
    "standstills",
    "would_overspend",
]
