"""Playbacks until every channel is within 10 %: the shipped project, and its events as single campaigns."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import duralab
from duralab.campaign import load_project
from duralab.display import text_table


def main() -> None:
    """Run both and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--project", default="front_axle_events")
    parser.add_argument("--out", type=Path, default=Path("out") / "project_playbacks")
    asked = parser.parse_args()
    project = load_project(asked.project)
    with duralab.start(rigs=project.rigs, out=asked.out) as lab:
        together = lab.run_project(project, out=asked.out / "project")
        alone = {event.name: lab.run(event.campaign, out=asked.out / "single" / event.name) for event in project.events}
    rows, in_project, single = [], 0, 0
    for done in together.events:
        ours, theirs = done.result, alone[done.event.name]
        if ours is None:
            raise SystemExit(f"{done.event.name} has no result: {done.error}")
        errors = [f"{each.iterations.judged_error.max(axis=1)[-1]:.3f}" for each in (ours, theirs)]
        in_project += len(ours.iterations)
        single += len(theirs.iterations)
        counts = (str(len(ours.iterations)), errors[0], str(len(theirs.iterations)), errors[1])
        rows.append((done.event.name, done.started_from or "–", *counts))
    rows.append(("all", "", str(in_project), "", str(single), ""))
    table = text_table(("event", "starts from", "project", "error", "single", "error"), rows, left=2)
    fewer = 100 * (1 - in_project / single)
    saved = f"The project needs {in_project} playbacks, single campaigns {single}: {fewer:.0f} % fewer."
    sys.stdout.write(f"{table}\n{saved}\n")


if __name__ == "__main__":
    main()
