"""Targets: made from a road or a measured file, and edited step by step."""

from duralab.target.editing import EditedTarget, edit_signals
from duralab.target.making import describe_target, make_target, require_playable
from duralab.target.measured import read_target_file
from duralab.target.pre_test_levels import levels_by_pre_test

__all__ = [
    "EditedTarget",
    "describe_target",
    "edit_signals",
    "levels_by_pre_test",
    "make_target",
    "read_target_file",
    "require_playable",
]
