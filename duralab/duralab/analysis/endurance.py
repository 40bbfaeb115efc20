"""Trends of an endurance test: deviations of the statistics from their baseline, and damage against the plan."""

from __future__ import annotations

import numpy as np

from duralab.recording import EnduranceRecording
from duralab_monitoring import Statistic
from duralab_proto.v1 import sequencer_pb2

_MIN, _MAX, _RMS, _DAMAGE = (
    list(Statistic).index(each) for each in (Statistic.MIN, Statistic.MAX, Statistic.RMS, Statistic.DAMAGE)
)


def deviations(recording: EnduranceRecording) -> np.ndarray:
    """Return the deviation of each statistic from its baseline as a share, as used for learned limits.

    A baseline is the mean of the first repeats of an event with one drive; it is learned again after such a decision.
    Minimum and maximum are divided by half the range; mean, RMS and standard deviation by the RMS; damage is given as
    the equivalent change of amplitude.
    Returns: Deviations of shape (repeats, responses, statistics); NaN for a repeat whose end is unknown.
    """
    repeats, settings = recording.repeats, recording.schedule.monitoring
    values = repeats.statistics[:, :, : len(Statistic)].astype(np.float64)
    values[:, :, _DAMAGE] **= 1.0 / float(settings.damage_exponent)
    # Repeats with the same key have the same baseline.
    keys = np.stack([repeats.event, repeats.drive, np.searchsorted(_relearnt(recording), repeats.repeat, "right")])
    found = np.full(values.shape, np.nan)
    for key in np.unique(keys, axis=1).T:
        rows = np.flatnonzero((keys == key[:, None]).all(axis=0) & repeats.known)
        if rows.size:
            baseline = values[rows[: settings.baseline_repeats]].mean(axis=0)
            unit = baseline.copy()
            unit[:, [_MIN, _MAX]] = 0.5 * (baseline[:, _MAX] - baseline[:, _MIN])[:, None]
            unit[:, 2:5] = baseline[:, _RMS, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                found[rows] = np.where(unit > 0.0, (values[rows] - baseline) / unit, np.nan)
    return found


def _relearnt(recording: EnduranceRecording) -> list[int]:
    """Return the repeats before which the baselines were learned again, in order."""
    holds = {hold.number: hold.next_repeat for hold in recording.messages(sequencer_pb2.EnduranceHold)}
    return [
        holds[decision.hold]
        for decision in recording.messages(sequencer_pb2.EnduranceDecision)
        if decision.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_RELEARN and decision.hold in holds
    ]


def damage_so_far(recording: EnduranceRecording) -> np.ndarray:
    """Return the damage counted after each repeat, shape (repeats, responses); unknown damage counts as 0.

    The damage of a correction of a drive counts with the repeat before it.
    """
    each = np.nan_to_num(recording.repeats.damage)
    if not len(each):
        return each
    before = np.array([step.next_repeat for step in recording.corrections], dtype=np.int64)
    at = np.clip(np.searchsorted(recording.repeats.repeat, before) - 1, 0, None)
    np.add.at(each, at, np.nan_to_num(recording.correction_damage))
    return np.cumsum(each, axis=0)


def damage_plan(recording: EnduranceRecording) -> np.ndarray:
    """Return the damage that the test is to reach by the schedule's plan, shape (responses,); NaN without it."""
    plan = recording.schedule.plan
    given = {} if plan is None or plan.damage is None else plan.damage
    return np.array([given.get(name, np.nan) for name in recording.responses])


def planned_total(recording: EnduranceRecording) -> np.ndarray:
    """Return the planned damage of all repeats of the schedule, shape (responses,); NaN if unknown."""
    return _planned(recording, np.array(list(recording.schedule.repeats.values())))


def planned_so_far(recording: EnduranceRecording) -> np.ndarray:
    """Return the planned damage of the played repeats, shape (responses,)."""
    events = len(recording.schedule.events)
    return _planned(recording, np.bincount(recording.repeats.event, minlength=events))


def _planned(recording: EnduranceRecording, counts: np.ndarray) -> np.ndarray:
    played = counts > 0
    return counts[played] @ recording.planned_damage[played]
