"""What a recording consists of: its files, their topics and metadata, its steps, runs and summary."""

from recorder.format.content import (
    EPOCH,
    PART_METADATA,
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
from recorder.format.runs import MOST_BLOCKS, PlannedRun
from recorder.format.steps import Step, decode_step, type_name_of
from recorder.format.summary import SUMMARY_METADATA, Runs, Story, Streams, Summary, read_summary

__all__ = [
    "DAMAGED_FOLDER",
    "EPOCH",
    "MOST_BLOCKS",
    "PART_METADATA",
    "SCENARIO_METADATA",
    "SOFTWARE_METADATA",
    "STEP_TOPIC",
    "STORED_ONCE",
    "SUMMARY_METADATA",
    "Content",
    "Part",
    "PlannedRun",
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
    "read_summary",
    "recording_path",
    "recordings_in",
    "sha256_of",
    "type_name_of",
]
