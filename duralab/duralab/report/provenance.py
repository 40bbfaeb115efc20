"""Provenance of a result: description, seeds, versions and hashes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.metadata import version
from typing import Final

import numpy as np

from duralab.data import READ_FILE, Decided, Playback, StepRecord
from duralab.recording import Recording
from duralab.report.identification_words import identification_in_words
from duralab.report.update_words import iteration_in_words
from duralab_proto.decisions import revised_specification
from duralab_proto.v1 import iterator_pb2
from duralab_settings import DecisionKind


def method_in_words(specification: iterator_pb2.CampaignSpec) -> list[tuple[str, str]]:
    """Return the method of a campaign, as terms and their values."""
    samples = specification.target.samples.shape
    seconds = samples[1] / specification.target.sample_rate if len(samples) == 2 else 0.0
    stop = specification.stop
    return [
        ("Target", f"{specification.target_source}; {seconds:g} s at {specification.target.sample_rate:g} Hz"),
        ("Control band", _band(specification)),
        ("Identification", _identification(specification)),
        *iteration_in_words(specification),
        (
            "End",
            f"after {stop.iterations} playbacks"
            + (f", or at a relative RMS error of {stop.relative_rms_error:g}" if stop.relative_rms_error else "")
            + (
                f", with damage ratios of {stop.smallest_damage_ratio:g} to {stop.largest_damage_ratio:g}"
                if stop.largest_damage_ratio
                else ""
            )
            + (f", or when an error exceeds {stop.divergence_ratio:g} × its best" if stop.divergence_ratio else "")
            + (
                f", or when the best error falls by less than {100 * stop.smallest_improvement:.1f} %"
                if stop.smallest_improvement
                else ""
            )
            + (f", or before more than {stop.damage_budget:g} × the target's damage" if stop.damage_budget else "")
            + _bounds_in_words(stop),
        ),
    ]


def _identification(specification: iterator_pb2.CampaignSpec) -> str:
    """Return the experiments and the estimator as text; a second experiment only if there was a first one."""
    both = specification.HasField("at_target") and not specification.known.HasField("model")
    at_target = specification.at_target if both else None
    return identification_in_words(specification.excitation, specification.estimator, at_target)


def _bounds_in_words(stop: iterator_pb2.StopCriteria) -> str:
    """Return the bounds of a playback as text; empty without a bound, and for recordings older than bounds."""
    bounds = {
        "a relative RMS error of {:g}": stop.error_bound,
        "{:g} × the target's peak": stop.peak_bound,
        "{:g} × the target's damage": stop.damage_bound,
    }
    passed = [words.format(value) for words, value in bounds.items() if 0.0 < value < np.inf]
    return f", or where a channel passes {' or '.join(passed)} in a playback" if passed else ""


@dataclass(frozen=True)
class TargetStepRow:
    """Step between the measured file and the target, formatted."""

    number: int
    name: str
    settings: str
    before: str
    after: str
    finding: str


def target_step_rows(specification: iterator_pb2.CampaignSpec) -> list[TargetStepRow]:
    """Return the steps of editing the source, in order."""
    records = [StepRecord.from_message(step) for step in specification.target_steps]
    return [
        TargetStepRow(
            number=number,
            name=record.name.replace("_", " "),
            settings="–" if record.settings == "{}" else record.settings,
            before=f"{record.seconds_before:g} s, {record.sample_rate_before:g} Hz",
            after=f"{record.seconds_after:g} s, {record.sample_rate_after:g} Hz",
            finding=f"see the table below. {record.left_out}".rstrip(". ")
            if record.name == READ_FILE
            else record.finding,
        )
        for number, record in enumerate(records, start=0 if records and records[0].name == READ_FILE else 1)
    ]


@dataclass(frozen=True)
class SourceRow:
    """Source of one response in a file, formatted."""

    response: str
    source: str
    file_unit: str
    stated_unit: str
    factor: str
    sign: str
    before: tuple[str, str]
    after: tuple[str, str]


def source_rows(specification: iterator_pb2.CampaignSpec) -> list[SourceRow]:
    """Return the source of each response of a target from a file; empty for another target or an older recording."""
    if not specification.target_steps or specification.target_steps[0].name != READ_FILE:
        return []
    record = StepRecord.from_message(specification.target_steps[0])
    units = {channel.name: channel.unit for channel in specification.target.channels}
    rows = []
    for channel in record.channels:
        read = channel.source
        if read is None or read.factor is None:
            dash = ("–", "–")
            name = channel.channel.replace("_", " ")
            rows.append(SourceRow(name, "none, silent", dash[0], dash[0], dash[0], dash[0], dash, dash))
            continue
        unit = units.get(channel.channel, "")
        rows.append(
            SourceRow(
                response=channel.channel.replace("_", " "),
                source=read.source,
                file_unit=read.source_unit or "none",
                stated_unit=read.stated_unit or "–",
                factor=f"{abs(read.factor):.6g}",
                sign="turned" if read.factor < 0.0 else "kept",
                before=(f"{read.peak_before:.5g} {read.unit}", f"{read.rms_before:.5g} {read.unit}"),
                after=(f"{read.peak_after:.5g} {unit}", f"{read.rms_after:.5g} {unit}"),
            )
        )
    return rows


@dataclass(frozen=True)
class DecisionRow:
    """Decision at a hold point, formatted."""

    playback: int
    what: str
    name: str
    reason: str
    when: str


def decision_rows(recording: Recording) -> list[DecisionRow]:
    """Return the decisions at hold points, in order."""
    specification, rows = recording.specification, []
    for message in recording.decision_messages:
        found, before = Decided.from_message(message), specification
        specification = revised_specification(before, message)
        rows.append(
            DecisionRow(
                playback=found.playback,
                what=_decided_in_words(found, before, specification),
                name=found.name,
                reason=found.reason,
                when=f"{found.when:%Y-%m-%d %H:%M:%S} UTC",
            )
        )
    return rows


def _decided_in_words(found: Decided, before: iterator_pb2.CampaignSpec, after: iterator_pb2.CampaignSpec) -> str:
    if found.kind is DecisionKind.BACK:
        return f"back to playback {found.from_iteration}"
    if found.kind is not DecisionKind.CHANGE:
        return found.kind.value
    named = dict([*iteration_in_words(before), ("Control band", _band(before))])
    now = [*iteration_in_words(after), ("Control band", _band(after))]
    changed = [f"{term}: {value}" for term, value in now if named.get(term) != value]
    return f"change: {'; '.join(changed) or 'of settings that this report does not name'}"


def _band(specification: iterator_pb2.CampaignSpec) -> str:
    return f"{specification.lowest_frequency:g} to {specification.highest_frequency:g} Hz"


_MADE_BY: Final = "software"
"""Name of the recorder's metadata with software versions; its other metadata is shown elsewhere in the page."""


def provenance(recording: Recording, best: Playback) -> list[tuple[str, str]]:
    """Return seeds, versions and hashes, to reproduce the recording and to verify that it is identical."""
    specification, rig = recording.specification, recording.rig
    rows = [("Campaign", specification.id)]
    if specification.parent:
        rows.append(("Goes on from", f"{specification.parent}, playback {specification.parent_iteration or 'last'}"))
    rows.append(("Seed", str(specification.seed)))
    if specification.target_rig:
        rows.append(("Target made on", f"{specification.target_rig}, seed {specification.target_seed}"))
    rows += [
        ("Target", f"sha256 {hashlib.sha256(specification.target.samples.data).hexdigest()}"),
        (f"Drive of playback {best.number}", f"sha256 {_content(best.drive.samples)}"),
        (f"Response of playback {best.number}", f"sha256 {_content(best.response.samples)}"),
        ("Rig", f"{rig.rig}: {rig.specimen}"),
        ("Rig engine", f"{rig.engine} {rig.version}"),
        ("Rig content", f"sha256 {rig.content_hash}"),
        ("Model", f"sha256 {recording.model.id}" if recording.model is not None else "none"),
        ("Recording", f"{', '.join(path.name for path in recording.files)}, sha256 {recording.sha256}"),
        ("Recorded with", ", ".join(f"{name} {number}" for name, number in _software(recording)) or "not told"),
        ("Report made with", f"duralab {version('duralab')}"),
    ]
    return rows


def _software(recording: Recording) -> list[tuple[str, str]]:
    return sorted(recording.metadata.get(_MADE_BY, {}).items())


def _content(samples: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").tobytes()).hexdigest()
