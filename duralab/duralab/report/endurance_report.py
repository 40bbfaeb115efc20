"""Report of an endurance test: progress, damage against the plan, trends, alarms, and repeats without samples."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.analysis import damage_plan, deviations, planned_so_far, planned_total
from duralab.errors import InputError
from duralab.recording import EnduranceRecording
from duralab.report import endurance_figures as figures
from duralab.report.drawing import Figure
from duralab.report.rendering import render, write_page
from duralab_monitoring import Statistic
from duralab_proto.v1 import sequencer_pb2
from duralab_schedules import KeepRule, in_bytes

MOST_ALARMS_DRAWN: Final = 24
"""Maximum number of alarms with drawn samples: aborts first, then the earliest."""

MOST_ALARMS_LISTED: Final = 500

_DAMAGE_HEADS: Final = (
    *("Channel", "counted", "of it by corrections", "planned so far", "planned in all"),
    *("over planned so far", "over planned in all"),
)
_PLAN_HEADS: Final = ("damage plan", "over the damage plan")

_TONES: Final = {
    sequencer_pb2.ENDURANCE_PHASE_FINISHED: "good",
    sequencer_pb2.ENDURANCE_PHASE_STOPPED: "bad",
    sequencer_pb2.ENDURANCE_PHASE_FAULTED: "bad",
}


def write_endurance_report(source: str | Path | EnduranceRecording, path: str | Path) -> Path:
    """Write the report of an endurance test.

    `source`: One of its recordings; the others are beside it. `path`: Path of the HTML file; an existing one is
    replaced when the new one is complete.
    Returns: Path of the report.
    Raises `InputError`: A recording cannot be read or has no repeat, or `path` is a file of it.
    """
    recording = source if isinstance(source, EnduranceRecording) else EnduranceRecording(source)
    return write_page(path, lambda: _render(recording), read=recording.files)


def _render(recording: EnduranceRecording) -> str:
    repeats = recording.repeats
    if not len(repeats):
        raise InputError(
            f"The recording {recording.path} holds no repeat yet, so there is nothing to report; give one that has."
        )
    planned, so_far, plan = planned_total(recording), planned_so_far(recording), damage_plan(recording)
    has_plan = bool(np.isfinite(plan).any())
    of_corrections = np.nan_to_num(recording.correction_damage).sum(axis=0)
    counted = np.nan_to_num(repeats.damage).sum(axis=0) + of_corrections
    drawn = _alarm_figures(recording)
    status, schedule = recording.status, recording.schedule
    titles = [name.replace("_", " ") for name in recording.responses]
    return render(
        "endurance.html.j2",
        figures={
            "damage": figures.damage_over_plan(recording, plan if has_plan else planned),
            **_trend_figures(recording),
            **{f"alarm-{number}": figure for number, (_, figure) in enumerate(drawn)},
        },
        recording=recording,
        specification=recording.specification,
        schedule=schedule,
        verdict=_verdict(recording),
        tone=_TONES.get(status.phase, "") if status is not None else "",
        badge="under way"
        if status is None
        else _words(sequencer_pb2.EndurancePhase.Name(status.phase), "ENDURANCE_PHASE_"),
        played=len(repeats),
        total=schedule.total_repeats,
        kept=int(repeats.kept.sum()),
        levels=_levels(recording),
        is_planned=has_plan or bool(np.isfinite(planned).any()),
        drawn_over="damage plan" if has_plan else "planned damage of the whole schedule",
        damage_heads=(*_DAMAGE_HEADS, *(_PLAN_HEADS if has_plan else ())),
        ratio=_ratio_range(counted, so_far),
        events=_event_rows(recording),
        damage=[
            (title, f"{a:.3g}", f"{part:.3g}", _figure(b), _figure(c), _ratio(a, b), _ratio(a, c))
            + ((_figure(d), _ratio(a, d)) if has_plan else ())
            for title, a, part, b, c, d in zip(titles, counted, of_corrections, so_far, planned, plan, strict=True)
        ],
        corrections=[step.reason for step in recording.corrections],
        statistics=list(Statistic),
        channel_options=sorted(enumerate(titles), key=lambda option: -_alarms_of(recording, option[0])),
        alarms=[_alarm_row(recording, alarm) for alarm in recording.alarms[:MOST_ALARMS_LISTED]],
        alarms_in_all=len(recording.alarms),
        alarm_options=[(number, sentence) for number, (sentence, _) in enumerate(drawn)],
        decisions=_decision_rows(recording),
        kept_rule=_rule_in_words(schedule.keep),
        not_kept=_not_kept_rows(recording),
        unknown=[step.reason for step in recording.unknown],
        files=[(path.name, in_bytes(path.stat().st_size)) for path in recording.files],
        monitoring=schedule.monitoring,
    )


def _alarms_of(recording: EnduranceRecording, row: int) -> int:
    return sum(alarm.channel == recording.responses[row] for alarm in recording.alarms)


def _words(name: str, prefix: str) -> str:
    return name.removeprefix(prefix).lower().replace("_", " ")


def _verdict(recording: EnduranceRecording) -> str:
    """Return a sentence about the progress and the alarms."""
    repeats, status = recording.repeats, recording.status
    ended = "It has not ended, or its end is not recorded." if status is None else f"It {_ending(status)}."
    unknown = len(recording.unknown)
    unknown_ends = f", of which the end of {unknown} is not known" if unknown else ""
    levels = _levels(recording)
    found = (
        f"{levels['abort']} aborts and {levels['warning']} warnings were raised, the first in repeat "
        f"{recording.alarms[0].repeat}"
        if recording.alarms
        else "no alarm was raised"
    )
    return f"{len(repeats)} of {recording.schedule.total_repeats} repeats were played{unknown_ends}; {found}. {ended}"


def _ending(status: sequencer_pb2.EnduranceStatus) -> str:
    reason = f" ({status.fault.message.rstrip('.')})" if status.HasField("fault") else ""
    return f"{_words(sequencer_pb2.EndurancePhase.Name(status.phase), 'ENDURANCE_PHASE_')}{reason}"


def _levels(recording: EnduranceRecording) -> dict[str, int]:
    levels = [alarm.level for alarm in recording.alarms]
    return {
        "warning": levels.count(sequencer_pb2.ALARM_LEVEL_WARNING),
        "abort": levels.count(sequencer_pb2.ALARM_LEVEL_ABORT),
    }


def _figure(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "not known"


def _ratio(damage: float, planned: float) -> str:
    return f"{damage / planned:.3f}" if np.isfinite(planned) and planned > 0.0 else "–"


def _ratio_range(counted: np.ndarray, planned: np.ndarray) -> str:
    known = np.isfinite(planned) & (planned > 0.0)
    if not known.any():
        return "not known"
    ratio = counted[known] / planned[known]
    return f"{ratio.min():.2f}–{ratio.max():.2f}"


def _event_rows(recording: EnduranceRecording) -> list[tuple[str, ...]]:
    """Return a row for each event: name, played, planned, unknown, samples kept, drives, source of the drive."""
    repeats, rows = recording.repeats, []
    for number, (event, planned) in enumerate(
        zip(recording.specification.events, recording.schedule.repeats.values(), strict=True)
    ):
        mine = repeats.event == number
        counts = (mine.sum(), planned, (mine & ~repeats.known).sum(), (mine & repeats.kept).sum())
        drives = np.unique(repeats.drive[mine]).size
        rows.append((event.name, *(str(count) for count in counts), str(drives), event.source))
    return rows


def _trend_figures(recording: EnduranceRecording) -> dict[str, Figure]:
    found: dict[str, Figure] = {}
    deviation, levels = deviations(recording), recording.schedule.monitoring.learnt_limits
    residuals = range(len(Statistic), len(recording.columns))
    for row in range(len(recording.responses)):
        for column, statistic in enumerate(Statistic):
            found[f"{statistic}-{row}"] = figures.trend(recording, deviation[:, row, column], row, levels=levels)
        found[f"residual-{row}"] = figures.residual(recording, row, residuals)
    return found


def _alarm_figures(recording: EnduranceRecording) -> list[tuple[str, Figure]]:
    """Return sentence and figure of the drawn alarms, compared with the first kept repeat of their event."""
    repeats, found = recording.repeats, []
    ordered = sorted(recording.alarms, key=lambda alarm: (-alarm.level, alarm.repeat))
    for alarm in ordered:
        if len(found) == MOST_ALARMS_DRAWN:
            break
        # A first repeat with another drive cannot be the reference.
        at = np.flatnonzero(repeats.repeat == alarm.repeat)
        same = (
            repeats.kept & (repeats.event == alarm.event) & (repeats.drive == (repeats.drive[at[0]] if at.size else -1))
        )
        if not same.any() or repeats.repeat[same][0] >= alarm.repeat:
            continue
        early = int(repeats.repeat[same][0])
        response, reference = recording.response(alarm.repeat), recording.response(early)
        if response is None or reference is None:
            continue
        names = (f"repeat {alarm.repeat}", f"repeat {early}")
        row = recording.responses.index(alarm.channel)
        found.append((alarm.sentence, figures.around_alarm(response, reference, row, names=names)))
    return found


def _alarm_row(recording: EnduranceRecording, alarm: sequencer_pb2.EnduranceAlarm) -> dict[str, Any]:
    level = _words(sequencer_pb2.AlarmLevel.Name(alarm.level), "ALARM_LEVEL_")
    band = (alarm.lowest_frequency, alarm.highest_frequency)
    return {
        "repeat": alarm.repeat,
        "found": _moment(alarm.found),
        "level": level,
        "tone": "bad" if alarm.level == sequencer_pb2.ALARM_LEVEL_ABORT else "",
        "kind": _words(sequencer_pb2.AlarmKind.Name(alarm.kind), "ALARM_KIND_"),
        "event": recording.specification.events[alarm.event].name,
        "channel": alarm.channel.replace("_", " "),
        "band": f"{band[0]:g}–{band[1]:g} Hz" if any(band) else "–",
        "since": alarm.since_repeat,
        "sentence": alarm.sentence,
        "action": _words(sequencer_pb2.AlarmAction.Name(alarm.action), "ALARM_ACTION_"),
    }


def _moment(nanoseconds: int) -> str:
    """Return nanoseconds since 1970 UTC as text; a dash for 0, which is unknown."""
    return f"{datetime.fromtimestamp(nanoseconds / 1e9, UTC):%Y-%m-%d %H:%M} UTC" if nanoseconds else "–"


def _decision_rows(recording: EnduranceRecording) -> list[tuple[str, ...]]:
    """Return a row for each hold: number, next repeat, reason, decision, name, reason of the decision, time."""
    decisions = {decision.hold: decision for decision in recording.messages(sequencer_pb2.EnduranceDecision)}
    rows = []
    for hold in recording.messages(sequencer_pb2.EnduranceHold):
        decision = decisions.get(hold.number)
        answer = ("–", "–", "–", "–")
        if decision is not None:
            kind = _words(sequencer_pb2.EnduranceDecisionKind.Name(decision.kind), "ENDURANCE_DECISION_KIND_")
            answer = (kind, decision.name, decision.reason, _moment(decision.decided))
        rows.append((str(hold.number), str(hold.next_repeat), hold.reason, *answer))
    return rows


def _rule_in_words(rule: KeepRule) -> str:
    every = f", every {rule.every}th" if rule.every is not None else ""
    return f"of each event the first {rule.first}{every}, and {rule.around_alarm} before and after an alarm"


def _not_kept_rows(recording: EnduranceRecording) -> list[tuple[str, ...]]:
    """Return a row for each event: name, number of repeats without samples, number with samples, and the latter."""
    repeats, rows = recording.repeats, []
    for number, name in enumerate(recording.schedule.events):
        mine = repeats.event == number
        missing = np.flatnonzero(mine & ~repeats.kept)
        kept = repeats.repeat[mine & repeats.kept]
        shown = ", ".join(map(str, kept[:12])) + (f", … {kept[-1]}" if kept.size > 12 else "")
        rows.append((name, str(missing.size), str(kept.size), shown or "none"))
    return rows
