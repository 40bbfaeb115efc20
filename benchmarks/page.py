"""The figures as a page: goals with what was measured, rigs, growth."""

from __future__ import annotations

import textwrap
from typing import Any

from goals import GOALS, NOTES

_HEAD = """# Benchmarks

Written by `make bench`, like `out/bench.json`, which holds every figure; `benchmarks/` holds what measures them. Speed
is reported as a ratio to something measured in the same run, because machines differ. A goal that is missed stays here,
as missed.
"""

_RIG_ROWS = {
    "rtf": "times real time, one core",
    "rtf_two": "two rigs on two threads, added",
    "drake_rtf": "Drake's own engine",
    "error": "error, relative",
    "startup_cold": "start, cold, s",
    "startup_warm": "start, warm, s",
    "memory_peak": "memory at most, MiB",
    "memory_growth": "of it beyond the record of 120 s, MiB",
}


def page(document: dict[str, Any]) -> str:
    """Return the page of a run.

    Parameters
    ----------
    document : dict
        As in out/bench.json; what was not measured is left out.

    Returns
    -------
    str
        Markdown.
    """
    machine = ", ".join(f"{name} {value}" for name, value in document["machine"].items())
    parts = [_HEAD, f"The machine: {machine}.\n", *_goal_tables(document), _rigs(document), _growth(document)]
    return "\n".join(part for part in parts if part)


def missed(document: dict[str, Any]) -> list[str]:
    """Return the goals that were measured and missed, and what is no measurement, a line each."""
    found = []
    for goal in (goal for goals in GOALS.values() for goal in goals):
        value = goal.measured(document)
        if value is not None and (verdict := goal.verdict(value)) in ("missed", "no measurement"):
            found.append(f"{goal.what}: {number(value)} (goal {number(goal.bound)}, {verdict})")
    return found


def number(value: float | None) -> str:
    """Return a number with three digits, or a dash if there is no number."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _goal_tables(document: dict[str, Any]) -> list[str]:
    tables = []
    for title, goals in GOALS.items():
        rows = [(goal, value) for goal in goals if (value := goal.measured(document)) is not None]
        if not rows:
            continue
        lines = [f"## {title}\n", "| what | measured | goal | |", "|---|---|---|---|"]
        for goal, value in rows:
            sign = "≥" if goal.at_least else "≤"
            verdict = goal.verdict(value)
            emphasis = "**" if verdict in ("missed", "no measurement") else ""
            bound = f"{sign} {number(goal.bound)}" if goal.bound is not None else "–"
            lines.append(f"| {goal.what} | {number(value)} | {bound} | {emphasis}{verdict}{emphasis} |")
        lines += ["", *textwrap.wrap(_note(title, document), 120)]
        tables.append("\n".join(lines).rstrip() + "\n")
    return tables


def _note(title: str, document: dict[str, Any]) -> str:
    try:
        return NOTES.get(title, "").format_map(document).strip().replace("%", " %")
    except KeyError:
        return ""  # A file of before has not all that it tells of.


def _rigs(document: dict[str, Any]) -> str:
    rigs = document.get("rigs", {})
    if not rigs:
        return ""
    lines = ["## Every rig\n", f"| | {' | '.join(f'`{rig}`' for rig in rigs)} |", "|---" * (len(rigs) + 1) + "|"]
    for figure, words in _RIG_ROWS.items():
        lines.append(f"| {words} | {' | '.join(number(row[figure]) for row in rigs.values())} |")
    return "\n".join(lines) + "\n"


def _growth(document: dict[str, Any]) -> str:
    """Tell how times grow with length and channels, each over that of the first column."""
    found = {
        "averaging spectra, s of record": document.get("identification", {}).get("streamed_seconds"),
        "averaging spectra of 60 s, drives": document.get("identification", {}).get("spectra_seconds_by_channels"),
        "first drive, s of target": document.get("iteration", {}).get("first_drive_seconds_by_length"),
        "first drive of 120 s, drives": document.get("iteration", {}).get("first_drive_seconds_by_channels"),
    }
    rows = [
        f"| {what} | {'; '.join(f'{at}: {1e3 * seconds:.3g} ms' for at, seconds in times.items())} |"
        for what, times in found.items()
        if times
    ]
    rigs = document.get("rigs", {})
    if rigs:
        ratios = [row["rtf_two"] / row["rtf"] for row in rigs.values()]
        rows.append(f"| two rigs at once over one | {min(ratios):.2f} to {max(ratios):.2f} times as much |")
    return "\n".join(["## How it grows\n", "| with | |", "|---|---|", *rows]) + "\n" if rows else ""
