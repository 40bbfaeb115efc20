"""Text of the live view in Markdown: current activity of the campaign, and its error table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from duralab_proto.v1 import iterator_pb2, rig_pb2

_PHASES = {
    iterator_pb2.CAMPAIGN_PHASE_CHECKING: "checking",
    iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING: "identifying",
    iterator_pb2.CAMPAIGN_PHASE_ITERATING: "iterating",
    iterator_pb2.CAMPAIGN_PHASE_CONFIRMING: "confirming",
    iterator_pb2.CAMPAIGN_PHASE_FINISHED: "finished",
    iterator_pb2.CAMPAIGN_PHASE_FAULTED: "ended by a fault",
    iterator_pb2.CAMPAIGN_PHASE_STOPPED: "stopped",
}
_OUTCOMES = {
    iterator_pb2.OUTCOME_REACHED: "every channel is at or below the asked error",
    iterator_pb2.OUTCOME_ITERATIONS_USED: "all playbacks were used",
    iterator_pb2.OUTCOME_DIVERGED: "the error grew: diverged",
    iterator_pb2.OUTCOME_NO_IMPROVEMENT: "the last playbacks improved the best error too little",
    iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED: "one more playback would do more damage than is allowed",
    iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL: "a response stood still while its target moved: check its sensor",
    iterator_pb2.OUTCOME_BOUND_PASSED: "a playback passed a bound of error, peak or damage",
    iterator_pb2.OUTCOME_ENDED_AT_HOLD_POINT: "a person ended it at a hold point",
}

_MODES = {
    rig_pb2.RIG_MODE_IDLE: "at rest",
    rig_pb2.RIG_MODE_SETTLING: "going to the first sample",
    rig_pb2.RIG_MODE_PLAYING: "playing",
    rig_pb2.RIG_MODE_INTERLOCKED: "INTERLOCKED",
    rig_pb2.RIG_MODE_RAMPING_DOWN: "ramping down",
}

_EXPONENTS = (3.0, 5.0, 8.0)
"""Slopes of the S-N lines of the contract's damage figures, in its order."""

_OVER = (iterator_pb2.CAMPAIGN_PHASE_FINISHED, iterator_pb2.CAMPAIGN_PHASE_FAULTED)

COLUMNS_SHOWN = 7
"""Largest number of iterations in the table, so that it fits beside the plots: the first and the last ones."""


def best_iteration(
    iterations: Sequence[iterator_pb2.IterationMetrics], status: iterator_pb2.CampaignStatus | None = None
) -> int:
    """Return the number of the best playback as the iterator states it; 0 if there is no playback.

    Until a status includes the last playback: the one of the whole target with the smallest overall error.
    """
    if status is not None and len(status.iterations) == len(iterations):
        return status.best_iteration
    # Older recordings state no level: all their playbacks are of the whole target.
    whole = [metrics for metrics in iterations if metrics.level in (0.0, 1.0)]
    return min(whole, key=lambda metrics: metrics.overall_relative_rms_error).iteration if whole else 0


def error_table(
    iterations: Sequence[iterator_pb2.IterationMetrics], status: iterator_pb2.CampaignStatus | None = None
) -> str:
    """Return the relative RMS error in percent, a row for each channel, a column for each iteration, the best bold."""
    if not iterations:
        return ""
    best = best_iteration(iterations, status)
    shown = list(iterations)
    if len(shown) > COLUMNS_SHOWN:
        shown = [shown[0], *shown[1 - COLUMNS_SHOWN :]]

    def cell(value: float, iteration: int) -> str:
        if math.isnan(value):
            # A monitored channel without a target.
            return "–"
        text = f"{100 * value:.1f}"
        return f"**{text}**" if iteration == best else text

    lines = [
        "| error [%] | " + " | ".join(f"it. {metrics.iteration}" for metrics in shown) + " |",
        "|---|" + "---:|" * len(shown),
    ]
    for row, channel in enumerate(shown[0].channels):
        cells = (
            cell(metrics.channels[row].relative_rms_error, metrics.iteration) if row < len(metrics.channels) else "–"
            for metrics in shown
        )
        lines.append(f"| {channel.channel} | " + " | ".join(cells) + " |")
    overall = (cell(metrics.overall_relative_rms_error, metrics.iteration) for metrics in shown)
    lines.append("| all | " + " | ".join(overall) + " |")
    return "\n".join(lines)


def damage_table(
    iterations: Sequence[iterator_pb2.IterationMetrics],
    confirmations: Sequence[iterator_pb2.IterationMetrics] = (),
    *,
    exponent: float,
) -> str:
    """Return the damage spent on the specimen in passes of the target, a row for each channel.

    `exponent`: Slope of the S-N line: 3, 5 or 8.
    """
    column = _EXPONENTS.index(exponent)
    playbacks = (*iterations, *confirmations)
    if any(len(channel.specimen_damage) <= column for metrics in playbacks for channel in metrics.channels):
        return "Damage spent on the specimen: not stated in this recording."
    lines = [f"| damage spent [passes of the target], k = {exponent:g} | identification | playbacks | sum |"]
    lines.append("|---|---:|---:|---:|")
    for row, channel in enumerate(iterations[-1].channels):
        known = len(channel.identification_damage) > column
        identification = channel.identification_damage[column] if known else math.nan
        played = sum(metrics.channels[row].specimen_damage[column] for metrics in playbacks)
        cells = map(_passes, (identification, played, played + (identification if known else 0.0)))
        lines.append(f"| {channel.channel} | " + " | ".join(cells) + " |")
    if any(not channel.identification_damage for channel in iterations[-1].channels):
        lines.append("\nThe recording does not state the damage of the identification, so that is not counted.")
    return "\n".join(lines)


def _passes(damage: float) -> str:
    if math.isnan(damage):
        # No target, or not stated.
        return "–"
    if 0.0 < damage < 0.1:
        return "< 0.1"
    return f"{damage:.1f}" if damage < 100 else f"{float(f'{damage:.3g}'):,.0f}"


def status_line(status: iterator_pb2.CampaignStatus) -> str:
    """Return the phase and the current activity, or the fault, in one line."""
    what = status.fault.message if status.HasField("fault") else status.activity
    return ": ".join(part for part in (_PHASES.get(status.phase, "starting"), what) if part)


def state_line(state: rig_pb2.RigState) -> str:
    """Return the mode of a rig, its run and the reason of its interlock, in one line."""
    line = f"Rig {state.rig}: {_MODES.get(state.mode, 'in an unknown state')}"
    if state.run:
        # A latched rig may still move: it ramps down, or finishes a run that cannot be stopped.
        line += f", {'still moved by ' if state.mode == rig_pb2.RIG_MODE_INTERLOCKED else ''}run {state.run}"
    return f"{line}: {state.reason}" if state.reason else line


def reset_line(state: rig_pb2.RigState) -> str:
    """Return who cleared the last latch of a rig and why; empty if neither was given."""
    by = f"reset by {state.reset_name}" if state.reset_name else "reset" if state.reset_reason else ""
    return f"{by}: {state.reset_reason}" if state.reset_reason else by


def status_document(
    status: iterator_pb2.CampaignStatus | None,
    iterations: Sequence[iterator_pb2.IterationMetrics],
    *,
    state: rig_pb2.RigState | None = None,
    exponent: float = 5.0,
) -> str:
    """Return the rig's state, the phase, the current activity, the errors, and the damage at a slope."""
    lines = []
    if state is not None:
        # An interlock is shown as a heading: it stops all work.
        lines.append(f"# {state_line(state)}" if state.mode == rig_pb2.RIG_MODE_INTERLOCKED else state_line(state))
    if status is not None:
        phase = _PHASES.get(status.phase, "starting")
        outcome = _OUTCOMES.get(status.outcome)
        lines.append(f"**{status.id}**: {phase}" + (f" – {outcome}" if outcome else ""))
        # The activity of a campaign that ended is omitted.
        if status.activity and status.phase not in _OVER:
            lines.append(f"{status.activity} ({100 * status.fraction:.0f} % done)")
        if status.HasField("fault"):
            lines.append(f"**Fault**: {status.fault.message}")
    if iterations:
        lines.append("Curves: grey the target, orange the newest playback, thin blue the first.")
        lines.append(error_table(iterations, status))
        lines.append(damage_table(iterations, () if status is None else status.confirmations, exponent=exponent))
    return "\n\n".join(lines) or "Waiting for the campaign."
