"""Format of a recording: its files, their topics and metadata, its steps, runs and summary."""

from recorder.format.content import (
    SCENARIO_METADATA,
    SOFTWARE_METADATA,
    STEP_TOPIC,
    STORED_ONCE,
    Content,
)
from recorder.format.files import (
    DAMAGED_FOLDER,
    Part,
    checked_name,
    existing_file,
    files_after_a_gap,
    files_of,
    recording_path,
    recordings_in,
    sha256_of,
)
from recorder.format.steps import STEP_TYPES, PlaybackStep, Step, decode_step, leaves_samples_out, type_name_of
from recorder.format.summary import MOST_BLOCKS, PlannedRun, Runs, Story, Streams, Summary, read_summary

__all__ = [
    "DAMAGED_FOLDER",
    "MOST_BLOCKS",
    "SCENARIO_METADATA",
    "SOFTWARE_METADATA",
    "STEP_TOPIC",
    "STEP_TYPES",
    "STORED_ONCE",
    "Content",
    "Part",
    "PlannedRun",
    "PlaybackStep",
    "Runs",
    "Step",
    "Story",
    "Streams",
    "Summary",
    "checked_name",
    "decode_step",
    "existing_file",
    "files_after_a_gap",
    "files_of",
    "leaves_samples_out",
    "read_summary",
    "recording_path",
    "recordings_in",
    "sha256_of",
    "type_name_of",
]
