"""Load histories: rainflow counting and pseudo-damage, and preparation of a measured history for a test.

Plain functions on records of shape (channels, samples); every one returns a new record.
"""

from duralab_loads.damage_shortening import Shortened, damage_over_time, shorten_by_damage
from duralab_loads.drift import remove_drift, remove_mean
from duralab_loads.fades import join_sections, rising_fade, taper_ends
from duralab_loads.levels import count_exceeded_ranges, count_level_crossings, share_of_time_at_level
from duralab_loads.load_cycles import (
    DAMAGE_EXPONENTS,
    LoadCycles,
    channel_damage,
    count_load_cycles,
    damage_ratio,
    pseudo_damage,
)
from duralab_loads.resampling import resample
from duralab_loads.spikes import Despiked, remove_spikes
from duralab_loads.zero_phase_filter import FilterKind, filter_zero_phase

__all__ = [
    "DAMAGE_EXPONENTS",
    "Despiked",
    "FilterKind",
    "LoadCycles",
    "Shortened",
    "channel_damage",
    "count_exceeded_ranges",
    "count_level_crossings",
    "count_load_cycles",
    "damage_over_time",
    "damage_ratio",
    "filter_zero_phase",
    "join_sections",
    "pseudo_damage",
    "remove_drift",
    "remove_mean",
    "remove_spikes",
    "resample",
    "rising_fade",
    "share_of_time_at_level",
    "shorten_by_damage",
    "taper_ends",
]
