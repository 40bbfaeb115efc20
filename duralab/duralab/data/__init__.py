"""Data classes of the SDK: rigs, signals, models, playbacks and the numbers of iterations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.data.band import BandNote, response_note, target_note
    from duralab.data.band_index import marked
    from duralab.data.hold import Decided, Proposal, ProposedDrive, ProposedResponse
    from duralab.data.identification import Convergence, ExperimentPlan, LevelAdvice, LevelSeries, ModelDifference
    from duralab.data.iterations import (
        DAMAGE_SLOPES,
        IterationTable,
        counted_slope,
        damage_note,
        damage_sources,
        iterations_html,
        passes,
    )
    from duralab.data.model import Distortion, Model, excited_lines
    from duralab.data.playback import ActuatorUse, Playback, actuator_use, level_of, playback_of
    from duralab.data.played import Played
    from duralab.data.pre_test import PreTest, PreTestFinding
    from duralab.data.recorded_signals import RecordedTarget
    from duralab.data.rig import SENSOR_COLUMNS, Rig, Rigs, sensor_rows
    from duralab.data.rig_state import RigMode, RigState
    from duralab.data.sensor import Sensor
    from duralab.data.signals import LARGEST_RATE_ERROR, Channel, Signals, channels_of
    from duralab.data.target_steps import READ_FILE, ChannelRecord, SourceRecord, StepRecord, step_record

__all__ = [
    "DAMAGE_SLOPES",
    "LARGEST_RATE_ERROR",
    "READ_FILE",
    "SENSOR_COLUMNS",
    "ActuatorUse",
    "BandNote",
    "Channel",
    "ChannelRecord",
    "Convergence",
    "Decided",
    "Distortion",
    "ExperimentPlan",
    "IterationTable",
    "LevelAdvice",
    "LevelSeries",
    "Model",
    "ModelDifference",
    "Playback",
    "Played",
    "PreTest",
    "PreTestFinding",
    "Proposal",
    "ProposedDrive",
    "ProposedResponse",
    "RecordedTarget",
    "Rig",
    "RigMode",
    "RigState",
    "Rigs",
    "Sensor",
    "Signals",
    "SourceRecord",
    "StepRecord",
    "actuator_use",
    "channels_of",
    "counted_slope",
    "damage_note",
    "damage_sources",
    "excited_lines",
    "iterations_html",
    "level_of",
    "marked",
    "passes",
    "playback_of",
    "response_note",
    "sensor_rows",
    "step_record",
    "target_note",
]

__getattr__ = lazy_face(__name__)
