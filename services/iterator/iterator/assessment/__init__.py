"""Assessment of playbacks: error figures, spectra, bounds, dead sensors, and the end of the iteration."""

from iterator.assessment.forecast import Forecast, forecast_playback
from iterator.assessment.metrics import IterationMetrics, best_iteration, judge_response
from iterator.assessment.playback_bounds import (
    NO_BOUNDS,
    BoundedQuantity,
    PassedBound,
    PlaybackBoundError,
    is_bounded,
    passed_bound,
)
from iterator.assessment.playback_levels import (
    best_at_full_level,
    comparable_history,
    judge_end_at_levels,
    level_of,
    partial_playbacks,
)
from iterator.assessment.repeatability import Repeatability, judge_repeatability
from iterator.assessment.spectrum_overlay import SpectrumOverlay, overlay_spectra
from iterator.assessment.standstill import Standstill, standstills
from iterator.assessment.stop_criteria import (
    Outcome,
    damage_spent,
    judge_end,
    would_overspend,
)

__all__ = [
    "NO_BOUNDS",
    "BoundedQuantity",
    "Forecast",
    "IterationMetrics",
    "Outcome",
    "PassedBound",
    "PlaybackBoundError",
    "Repeatability",
    "SpectrumOverlay",
    "Standstill",
    "best_at_full_level",
    "best_iteration",
    "comparable_history",
    "damage_spent",
    "forecast_playback",
    "is_bounded",
    "judge_end",
    "judge_end_at_levels",
    "judge_repeatability",
    "judge_response",
    "level_of",
    "overlay_spectra",
    "partial_playbacks",
    "passed_bound",
    "standstills",
    "would_overspend",
]
