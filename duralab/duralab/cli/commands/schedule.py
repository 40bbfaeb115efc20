"""`duralab schedule show` and `duralab schedule design`: what a schedule comes to, and its repeats from damage."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Json, Replace
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.schedule import ScheduleForecast

ScheduleFile = Annotated[Path, typer.Argument(metavar="SCHEDULE", help="A schedule file.")]
Recordings = Annotated[
    Path | None,
    typer.Option(
        "--recordings", metavar="DIR", help="Folder of a recorder, for recordings that are named by their id."
    ),
]


def show(schedule: ScheduleFile, *, recordings: Recordings = None, as_json: Json = False) -> None:
    """Show duration, damage against the plan and disk space of a schedule; refuse one that cannot be started."""
    from duralab.schedule import forecast_schedule, load_schedule

    output = Output(as_json)
    expected = forecast_schedule(load_schedule(schedule), recordings=recordings)
    _say(expected, output)
    expected.require_playable()


def design(
    schedule: ScheduleFile,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the schedule with its repeats into this file.")
    ] = None,
    recordings: Recordings = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Choose repeats of events so that the damage of all channels meets the plan of the schedule."""
    from duralab.output_files import replace_when_complete, require_outputs
    from duralab.schedule import design_schedule, load_schedule, schedule_text

    output = Output(as_json)
    if replace and out is None:
        raise InputError("--replace goes with --out; leave it out.", field="replace")
    if out is not None:
        require_outputs([out], replace=replace, read=[schedule])
    designed = design_schedule(load_schedule(schedule), recordings=recordings)
    if out is not None:
        with replace_when_complete(out) as temporary:
            temporary.write_text(
                f"# Repeats designed from {schedule.name} by `duralab schedule design`.\n"
                + schedule_text(designed.schedule, folder=out.parent),
                encoding="utf-8",
            )
    _say(designed, output)
    if out is not None:
        output.say(f"Schedule: {out}")
    designed.require_playable()


def _say(expected: ScheduleForecast, output: Output) -> None:
    document = {
        "schedule": expected.schedule.name,
        "planned": expected.planned,
        "misfit": expected.misfit,
        "bytes": expected.forecast.bytes,
        "notes": expected.notes,
        **asdict(expected.forecast),
    }
    if not output.document(document):
        output.say(*str(expected).splitlines())
