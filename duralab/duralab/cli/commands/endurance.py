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
Reason = Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; kept in the recording.")]


class Choice(StrEnum):
    """What can be decided when an endurance test holds."""

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
    """Start an endurance test in the running lab; it goes on there."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        test = lab.endure(schedule, id=id, seed=seed, real_time=real_time)
        _show(test.progress(), output)


def status(id: EnduranceId, *, endpoint: Connect = None, as_json: Json = False) -> None:
    """Show how far an endurance test is: repeats, damage, alarms, what it waits for."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).progress(), output)


def hold(id: EnduranceId, *, reason: Reason = "", endpoint: Connect = None, as_json: Json = False) -> None:
    """Have an endurance test wait after the repeat that plays now."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).hold(reason=reason), output)


def resume(id: EnduranceId, *, endpoint: Connect = None, as_json: Json = False) -> None:
    """Go on after a hold that a person or a fault made, or after a crash, at the next repeat."""
    from duralab.lab import connect

    output = Output(as_json)
    with connect(endpoint_of_lab(endpoint)) as lab:
        _show(lab.endurance(id).resume(), output)


def decide(
    id: EnduranceId,
    choice: Annotated[Choice, typer.Argument(metavar="[continue|iterate_again|relearn|end]", help="What is done.")],
    *,
    hold: Annotated[int, typer.Option("--hold", min=1, metavar="N", help="Number of the hold that is decided on.")],
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Who decides; kept in the recording.")],
    reason: Reason,
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Decide how an endurance test goes on that an alarm made wait."""
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
