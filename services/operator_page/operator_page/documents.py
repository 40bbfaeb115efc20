"""Documents of the lab for a browser: without infinities, arrays and objects."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from duralab import CatalogueEntry, Channel, IterationTable, Proposal, Rig, RigState, RunProgress, Signals
from duralab.lab import EnduranceAlarm, EnduranceProgress, ServiceHealth
from operator_page.envelope import MOST_BUCKETS, Envelope, rounded

HOLD_BUCKETS: Final = 600
"""Number of buckets of each of the four curves of a channel at a hold point."""


def number(value: float) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def numbers(values: np.ndarray) -> Any:
    """Return an array as nested lists of numbers."""
    return [numbers(row) for row in values] if values.ndim > 1 else [number(value) for value in values.tolist()]


def reset_sentence(state: RigState) -> str:
    """Return who cleared the last latch of a rig and why; empty if neither was given."""
    if not (state.reset_name or state.reset_reason):
        return ""
    by = f"Reset by {state.reset_name}" if state.reset_name else "Reset"
    return f"{by}: {state.reset_reason}" if state.reset_reason else f"{by}."


def campaign_document(id: str, progress: RunProgress, *, rig: str, ended: bool, age: float) -> dict[str, Any]:
    """Return the progress of a campaign."""
    return {
        "id": id,
        "rig": rig,
        "ended": ended,
        "age": age,
        "activity": progress.activity,
        "fraction": number(progress.fraction),
        # None while it waits for a person.
        "remaining": number(progress.remaining_seconds)
        if progress.remaining_seconds >= 0 and progress.hold is None
        else None,
        "table": None if progress.iterations is None else _table(progress.iterations),
        "hold": None if progress.hold is None else proposal_document(progress.hold),
    }


def _table(table: IterationTable) -> dict[str, Any]:
    return {
        "channels": list(table.channels),
        "watched": table.watched.tolist(),
        "numbers": list(table.numbers),
        "level": numbers(table.level),
        "overall": numbers(table.overall),
        "error": numbers(table.relative_rms_error),
        "peak": numbers(table.peak_ratio),
        # For slope 5, the default of the damage count.
        "damage": numbers(table.damage_ratio[:, :, 1]),
        "predicted": None if table.predicted_error is None else numbers(table.predicted_error),
        "best": table.numbers[table.best] if len(table) else None,
    }


def proposal_document(proposal: Proposal) -> dict[str, Any]:
    """Return the proposal of a campaign without samples."""
    return {
        "number": proposal.number,
        "playback": proposal.playback,
        "reason": proposal.reason,
        "level": number(proposal.level),
        "follows": proposal.follows,
        "overall": number(proposal.overall_error),
        "remarks": list(proposal.remarks),
        "refusal": proposal.refusal,
        "drives": [
            {**vars(use), **{k: number(v) for k, v in vars(use).items() if k != "channel"}} for use in proposal.drives
        ],
        "responses": [
            {
                "channel": each.channel,
                "error": number(each.relative_rms_error),
                "peak": number(each.peak_ratio),
                "damage": number(each.damage_ratio[1]) if len(each.damage_ratio) > 1 else None,
                "uncertainty": number(each.uncertainty),
            }
            for each in proposal.responses
        ],
    }


def proposal_curves(proposal: Proposal, last_drive: Signals | None) -> dict[str, Any]:
    """Return the next drive, that of the playback it follows, and the predicted responses, thinned."""
    drive, predicted = proposal.drive, None
    if drive is not None and proposal.predicted is not None:
        names = tuple(Channel(each.channel, "") for each in proposal.responses)
        predicted = Signals(names, drive.sample_rate, np.asarray(proposal.predicted, dtype=np.float64))
    return {
        name: None if signals is None else signals_document(signals, buckets=HOLD_BUCKETS)
        for name, signals in (("drive", drive), ("last_drive", last_drive), ("predicted", predicted))
    }


def endurance_document(progress: EnduranceProgress, *, ended: bool, age: float, read: int) -> dict[str, Any]:
    """Return the progress of an endurance test; `read`: Number of repeats whose figures are available."""
    return {
        "id": progress.id,
        "rig": progress.rig,
        "phase": progress.phase.value,
        "ended": ended,
        "age": age,
        "activity": progress.activity,
        "repeats": progress.repeats,
        "played": progress.played,
        "unknown": progress.unknown,
        "remaining": number(progress.remaining_seconds) if progress.remaining_seconds >= 0 else None,
        "events": [[name, played, planned] for name, (played, planned) in progress.events.items()],
        "damage": [
            [
                name,
                number(counted),
                *(number(each.get(name, math.nan)) for each in (progress.planned, progress.planned_whole)),
            ]
            for name, counted in progress.damage.items()
        ],
        "correction_playbacks": progress.correction_playbacks,
        "correction_damage": {name: number(part) for name, part in progress.correction_damage.items()},
        "alarms": progress.alarms,
        "hold": progress.hold,
        "hold_alarms": progress.hold_alarms,
        "reason": progress.reason,
        "remarks": list(progress.remarks),
        "recording": progress.recording,
        "kept": progress.kept,
        "read": read,
    }


def alarm_document(alarm: EnduranceAlarm) -> dict[str, Any]:
    """Return an alarm; `found`: Time in seconds since 1970, None in recordings of versions without a time."""
    return {
        **vars(alarm),
        "size": number(alarm.size),
        "band": list(alarm.band) if alarm.band else None,
        "found": alarm.found.timestamp() if alarm.found else None,
    }


def service_document(health: ServiceHealth) -> dict[str, Any]:
    """Return the health of a service."""
    free = health.value("duralab_recorder_free_bytes")
    return {
        "service": health.service,
        "instance": health.instance,
        "up": number(health.up_seconds),
        "trouble": health.trouble,
        "free_bytes": None if free is None else number(free),
    }


def rig_document(rig: Rig) -> dict[str, Any]:
    """Return the description of a rig: channels, limits, sensors."""
    return {
        "name": rig.name,
        "specimen": rig.specimen,
        "engine": rig.engine,
        "version": rig.version,
        "sample_rate": rig.sample_rate,
        "longest_drive_seconds": number(rig.longest_drive_seconds),
        "simulated": rig.simulated,
        "cannot_be_stopped": rig.cannot_be_stopped,
        "overdue": list(rig.overdue),
        "rest": numbers(rig.static_response),
        "drives": [_channel(each) for each in rig.drives],
        "responses": [_channel(each) for each in rig.responses],
    }


def _channel(channel: Any) -> dict[str, Any]:
    sensor = channel.sensor
    return {
        "name": channel.name,
        "unit": channel.unit,
        "label": channel.label,
        "minimum": number(channel.minimum),
        "maximum": number(channel.maximum),
        "slew_limit": number(channel.slew_limit) or None,
        "watchdog": number(channel.watchdog) or None,
        "sensor": None
        if sensor is None
        else {
            "serial_number": sensor.serial_number,
            "calibration_due": sensor.calibration_due,
            "warning_level": number(sensor.warning_level) or None,
            "abort_level": number(sensor.abort_level) or None,
        },
    }


def target_document(target: Signals) -> dict[str, Any]:
    """Return a target without its static part, the straight line from its first to its last sample, thinned."""
    first, last = target.samples[:, :1], target.samples[:, -1:]
    return signals_document(
        replace(target, samples=target.samples - np.linspace(first, last, target.samples.shape[1], axis=1)[..., 0])
    )


def recording_document(entry: CatalogueEntry) -> dict[str, Any]:
    """Return the catalogue entry of a recording."""
    return {
        "id": entry.id,
        "rig": entry.rig,
        "target": entry.target,
        "begun": None if entry.begun is None else entry.begun.timestamp(),
        "result": entry.result.value,
        "closed": entry.closed,
        "missing": entry.missing_blocks,
        "bytes": entry.bytes,
    }


def signals_document(signals: Signals, *, buckets: int = MOST_BUCKETS) -> dict[str, Any]:
    """Return a whole record, thinned."""
    envelope = Envelope(signals.samples.shape[0], samples=signals.samples.shape[1], buckets=buckets)
    envelope.put(0, signals.samples)
    low, high = envelope.part(0)
    return {
        "channels": [{"name": each.name, "unit": each.unit} for each in signals.channels],
        "seconds": signals.duration,
        "sample_rate": signals.sample_rate,
        "bucket_seconds": envelope.bucket_samples / signals.sample_rate,
        "low": rounded(low),
        "high": rounded(high),
    }
