"""Targets: made from a road or a measured file, and edited step by step."""

from duralab.target.editing import EditedTarget, edit_signals
from duralab.target.making import describe_target, make_target, require_playable
from duralab.target.measured import read_target_file

__all__ = [
    "EditedTarget",
    "describe_target",
    "edit_signals",
    "make_target",
    "read_target_file",
    "require_playable",
]
