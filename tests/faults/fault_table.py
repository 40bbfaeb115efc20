"""The table of faults, for people and for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from .malformed_queries import Tally
from .rounds import Rounds
from .soak import Soak

_HEAD = ("fault", "rounds", "lost", "doubled", "reordered", "recovered in s (median, most)", "how", "")


def table(results: Sequence[Rounds]) -> str:
    """Return a line for each fault: what was lost, and how long it took until the campaign went on."""
    rows = [_HEAD, *(_row(result) for result in results)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
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
    path: Path, results: Sequence[Rounds], *, seed: int, tallies: dict[str, Tally] | None, soak: Soak | None
) -> None:
    """Write everything that was measured as JSON."""
    content = {
        "seed": seed,
        "faults": [{**asdict(result), "findings": result.findings} for result in results],
        "malformed_queries": {service: asdict(tally) for service, tally in (tallies or {}).items()},
        "soak": asdict(soak) if soak is not None else None,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1))
