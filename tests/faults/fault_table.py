"""The table of faults, for people and for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from .file_faults import FileRounds
from .malformed_queries import Tally
from .rounds import Rounds
from .soak import Soak

_FILE_HEAD = ("fault of the controller", "rounds", "judged rightly", "slowest round in s", "")
_HEAD = ("fault", "rounds", "lost", "doubled", "reordered", "recovered in s (median, most)", "how", "")


def table(results: Sequence[Rounds]) -> str:
    """Return a line for each fault: what was lost, and how long it took until the campaign went on."""
    return _aligned([_HEAD, *(_row(result) for result in results)])


def file_table(results: Sequence[FileRounds]) -> str:
    """Return a line for each fault of a controller that exchanges files; those of pairs in one, but for findings."""
    pairs = [result for result in results if result.is_pair]
    alone = [result for result in results if not result.is_pair]
    whole = [(f"{len(pairs)} pairs of faults", pairs)] if pairs else []
    rows = [(result.fault, [result]) for result in alone] + whole
    rows += [(result.fault, [result]) for result in pairs if result.findings]
    return _aligned([_FILE_HEAD, *(_file_row(name, some) for name, some in rows)])


def _file_row(name: str, results: Sequence[FileRounds]) -> tuple[str, ...]:
    findings = sum(len(result.findings) for result in results)
    return (
        name,
        str(sum(result.rounds for result in results)),
        str(sum(result.right for result in results)),
        f"{max(result.slowest_seconds for result in results):.1f}",
        f"{findings} FINDINGS" if findings else "",
    )


def _aligned(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(lines)


def _row(result: Rounds) -> tuple[str, ...]:
    if result.skipped:
        return (result.fault, "0", "", "", "", "", "", f"left out: {result.skipped}")
    seconds = [each.recovered_seconds for each in result.rounds]
    endings = Counter(each.ending.value for each in result.rounds)
    return (
        result.fault,
        str(len(result.rounds)),
        *(str(sum(getattr(each, what) for each in result.rounds)) for what in ("lost", "doubled", "reordered")),
        f"{np.median(seconds):.1f}, {max(seconds):.1f}",
        ", ".join(f"{count} {ending.partition(':')[0]}" for ending, count in endings.items()),
        f"{len(result.findings)} FINDINGS" if result.findings else "",
    )


def tally_table(tallies: dict[str, Tally]) -> str:
    """Return a line for each service that was sent malformed queries."""
    return "\n".join(
        f"malformed queries to {service}: {tally.sent} sent over {tally.sessions} sessions, "
        f"slowest answer {tally.slowest_seconds:.2f} s; "
        + ", ".join(f"{count} {answer}" for answer, count in sorted(tally.answers.items(), key=lambda item: -item[1]))
        + (f"; {len(tally.findings)} FINDINGS" if tally.findings else "")
        for service, tally in tallies.items()
    )


def soak_table(soak: Soak) -> str:
    """Return how the memory of each service went."""
    head = f"soak of {soak.minutes:.1f} min: {soak.campaigns} campaigns, {soak.queries} queries"
    lines = [
        f"  {name}: {soak.early[name]:.0f} MiB in the second quarter, {soak.late[name]:.0f} MiB in the last"
        for name in soak.early
    ]
    return "\n".join([head, *lines])


def write_figures(
    path: Path,
    results: Sequence[Rounds],
    *,
    seed: int,
    tallies: dict[str, Tally] | None,
    soak: Soak | None,
    exchanged: Sequence[FileRounds],
) -> None:
    """Write everything that was measured as JSON."""
    content = {
        "seed": seed,
        "faults": [{**asdict(result), "findings": result.findings} for result in results],
        "malformed_queries": {service: asdict(tally) for service, tally in (tallies or {}).items()},
        "file_exchange": [asdict(result) for result in exchanged],
        "soak": asdict(soak) if soak is not None else None,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1))
