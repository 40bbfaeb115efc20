"""Comparison of recorded campaigns, trends of an endurance test, and a summary of signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.analysis.comparison import ChannelComparison, ComparedRecording, Comparison, Recorded, compare
    from duralab.analysis.endurance import damage_plan, damage_so_far, deviations, planned_so_far, planned_total
    from duralab.analysis.signal_summary import ENERGY_SHARE, ChannelSummary, SignalSummary, summarize

__all__ = [
    "ENERGY_SHARE",
    "ChannelComparison",
    "ChannelSummary",
    "ComparedRecording",
    "Comparison",
    "Recorded",
    "SignalSummary",
    "compare",
    "damage_plan",
    "damage_so_far",
    "deviations",
    "planned_so_far",
    "planned_total",
    "summarize",
]

__getattr__ = lazy_face(__name__)
