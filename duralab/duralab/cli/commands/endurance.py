"""`duralab endurance …`: start an endurance test, look at it, hold, decide, resume and stop it."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import Connect, Json, RealTime, Seed, endpoint_of_lab
from duralab.cli.output import Output

if TYPE_CHECKING:
    from duralab.lab import EnduranceProgress

EnduranceId = Annotated[str, typer.Argument(metavar="ID", help="Id of the endurance test: that of its schedule.")]
Reason = Annotated[str, typer.Option("--reason", metavar="TEXT", help="Reason; kept in the recording.")]


class Choice(StrEnum):
    """Decisions at a hold of an endurance test."""

    CONTINUE = "continue"
    ITERATE_AGAIN = "iterate_again"
    RELEARN = "relearn"
    END = "end"


def start(
    schedule: Annotated[Path, typer.Argument(metavar="SCHEDULE", help="A schedule file.")],
    *,
    id: Annotated[str | None, typer.Option("--id", metavar="ID", help="Id; that of the schedule if left out.")] = None,
    seed: Seed = 0,
    real_time: RealTime = False,
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Start an endurance test in the running lab."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        test = lab.endure(schedule, id=id, seed=seed, real_time=real_time)
        output.say(*test.notes)
        _show(test.progress(), output)


def status(id: EnduranceId, *, endpoint: Connect = None, as_json: Json = False) -> None:
    """Show the progress of an endurance test: repeats, damage, alarms, reason of a hold."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).progress(), output)


def hold(id: EnduranceId, *, reason: Reason = "", endpoint: Connect = None, as_json: Json = False) -> None:
    """Hold an endurance test after the current repeat."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).hold(reason=reason), output)


def resume(id: EnduranceId, *, endpoint: Connect = None, as_json: Json = False) -> None:
    """Continue an endurance test after a hold or a crash, at the next repeat."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).resume(), output)


def decide(
    id: EnduranceId,
    choice: Annotated[Choice, typer.Argument(metavar="DECISION", help="What to do.")],
    *,
    hold: Annotated[int, typer.Option("--hold", min=1, metavar="N", help="Number of the hold.")],
    name: Annotated[
        str, typer.Option("--name", metavar="NAME", help="Name of the person who decides; kept in the recording.")
    ],
    reason: Reason,
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Decide how to continue an endurance test that waits after an alarm."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).decide(choice.value, hold=hold, name=name, reason=reason), output)


def stop(id: EnduranceId, *, reason: Reason = "", endpoint: Connect = None, as_json: Json = False) -> None:
    """End an endurance test, and stop and latch its rig."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).stop(reason=reason), output)


def _show(progress: EnduranceProgress, output: Output) -> None:
    output.say(*str(progress).splitlines())
    output.document(asdict(progress))
