"""An endurance test on the bus: its checks, its repeats, its recordings and its status."""

from sequencer.endurance.endurance_test import EnduranceTest, Progress
from sequencer.endurance.messages import column_names
from sequencer.endurance.plan import EndurancePlan, plan_endurance, require_names
from sequencer.endurance.recorded import read_endurance
from sequencer.endurance.resumption import (
    fresh_progress,
    go_on_recording,
    recorded_progress,
    require_open,
    require_same_rig,
)
from sequencer.endurance.status_board import EnduranceBoard, is_final
from sequencer.endurance.test_log import last_volume

__all__ = [
    "EnduranceBoard",
    "EndurancePlan",
    "EnduranceTest",
    "Progress",
    "column_names",
    "fresh_progress",
    "go_on_recording",
    "is_final",
    "last_volume",
    "plan_endurance",
    "read_endurance",
    "recorded_progress",
    "require_names",
    "require_open",
    "require_same_rig",
]
