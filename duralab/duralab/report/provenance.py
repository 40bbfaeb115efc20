"""What was done, in words, and what is needed to do it again: seeds, versions and hashes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.metadata import version
from typing import Final

import numpy as np

from duralab.recording import Recording
from duralab.recording_content import Playback
from duralab.report.identification_words import identification_in_words
from duralab.report.update_words import iteration_in_words
from duralab.target_step_record import StepRecord
from duralab_proto.v1 import iterator_pb2


def method_in_words(specification: iterator_pb2.CampaignSpec) -> list[tuple[str, str]]:
    """Return what was done, as terms and their values."""
    samples = specification.target.samples.shape
    seconds = samples[1] / specification.target.sample_rate if len(samples) == 2 else 0.0
    stop = specification.stop
    return [
        ("Target", f"{specification.target_source}; {seconds:g} s at {specification.target.sample_rate:g} Hz"),
        ("Control band", f"{specification.lowest_frequency:g} to {specification.highest_frequency:g} Hz"),
        ("Identification", identification_in_words(specification.excitation, specification.estimator)),
        *iteration_in_words(specification),
        (
            "End",
            f"after {stop.largest_iterations} playbacks"
            + (f", or at a relative RMS error of {stop.relative_rms_error:g}" if stop.relative_rms_error else "")
            + (
                f", with damage ratios of {stop.smallest_damage_ratio:g} to {stop.largest_damage_ratio:g}"
                if stop.largest_damage_ratio
                else ""
            )
            + (f", or when an error exceeds {stop.divergence_ratio:g} × its best" if stop.divergence_ratio else "")
            + (
                f", or when the best error falls by less than {stop.smallest_improvement:.1%}"
                if stop.smallest_improvement
                else ""
            )
            + (f", or before more than {stop.damage_budget:g} × the target's damage" if stop.damage_budget else ""),
        ),
    ]


@dataclass(frozen=True)
class TargetStepRow:
    """One step of editing between the measured file and the target, as printed."""

    number: int
    name: str
    settings: str
    before: str
    after: str
    finding: str


def target_step_rows(specification: iterator_pb2.CampaignSpec) -> list[TargetStepRow]:
    """Return how the source was edited, in order."""
    records = [StepRecord.from_message(step) for step in specification.target_steps]
    return [
        TargetStepRow(
            number=number,
            name=record.name.replace("_", " "),
            settings=record.settings,
            before=f"{record.seconds_before:g} s, {record.sample_rate_before:g} Hz",
            after=f"{record.seconds_after:g} s, {record.sample_rate_after:g} Hz",
            finding=record.finding,
        )
        for number, record in enumerate(records, start=1)
    ]


_MADE_BY: Final = "software"
"""Name under which the recorder says what it was made of; its other notes say what stands elsewhere in the page."""


def provenance(recording: Recording, last: Playback) -> list[tuple[str, str]]:
    """Return seeds, versions and hashes: what is needed to make the same recording again, and to see that it is."""
    specification, rig = recording.specification, recording.rig
    rows = [("Campaign", specification.id)]
    if specification.parent:
        rows.append(("Goes on from", f"{specification.parent}, playback {specification.parent_iteration or 'last'}"))
    rows.append(("Seed", str(specification.seed)))
    if specification.target_rig:
        rows.append(("Target made on", f"{specification.target_rig}, seed {specification.target_seed}"))
    rows += [
        ("Target", f"sha256 {hashlib.sha256(specification.target.samples.data).hexdigest()}"),
        (f"Drive of playback {last.number}", f"sha256 {_content(last.drive.samples)}"),
        (f"Response of playback {last.number}", f"sha256 {_content(last.response.samples)}"),
        ("Rig", f"{rig.rig}: {rig.specimen}"),
        ("Rig engine", f"{rig.engine} {rig.version}"),
        ("Rig content", f"sha256 {rig.content_hash}"),
        ("Model", f"sha256 {recording.model.id}" if recording.model is not None else "none"),
        ("Recording", f"{recording.path.name}, sha256 {recording.sha256}"),
        ("Recorded with", ", ".join(f"{name} {number}" for name, number in _software(recording)) or "not told"),
        ("Report made with", f"duralab {version('duralab')}"),
    ]
    return rows


def _software(recording: Recording) -> list[tuple[str, str]]:
    return sorted(recording.metadata.get(_MADE_BY, {}).items())


def _content(samples: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").tobytes()).hexdigest()
