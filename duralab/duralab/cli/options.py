"""Options that several commands have, and the lab that a command uses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.cli.output import Output
    from duralab.lab import Lab


Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        help="Endpoint of the lab, e.g. tcp/127.0.0.1:7474; that of the running lab if left out.",
    ),
]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite existing output files.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON document on standard output.")]
OutFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for the outputs; out/<campaign> if left out.")
]
Pdf = Annotated[
    Path | None, typer.Option("--pdf", metavar="FILE", help="Write a PDF as well; needs Chromium or Chrome.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Random seed of the simulated rig.")]
RealTime = Annotated[
    bool, typer.Option("--real-time", help="Play no faster than real time, as a rehearsal of a real rig.")
]
View = Annotated[bool, typer.Option("--view", help="Open the live viewer.")]
Page = Annotated[bool, typer.Option("--page", help="Open the operator page on loopback, and say where.")]
Profile = Annotated[
    bool, typer.Option("--profile", help="Write profile.json, a trace of where the time goes, for ui.perfetto.dev.")
]
InputFormat = Annotated[
    str | None, typer.Option("--from-format", metavar="FORMAT", help="Format of the file read; by suffix if left out.")
]
Source = Annotated[Path, typer.Argument(metavar="IN", help="A file of signals.")]
Out = Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")]
Recording = Annotated[Path, typer.Argument(metavar="RECORDING", help="A recording.mcap.")]
ControllerMapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="MAP",
        help="YAML: channels, units and folder of a rig's controller; see the guide controller.md.",
    ),
]
TargetSettings = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        metavar="FILE",
        help="YAML with `channels`, `calculated` and `edit`, as under `target` of a campaign file.",
    ),
]
RunName = Annotated[
    str | None, typer.Option("--run", metavar="NAME", help="With --map: name of the run and of its files.")
]
Unit = Annotated[
    list[str] | None,
    typer.Option(
        "--unit", metavar="UNIT", help="SI; or a unit for all channels of its kind; or CHANNEL=UNIT; repeatable."
    ),
]
FileFormat = Annotated[
    str | None,
    typer.Option("--format", metavar="FORMAT", help="rpc3, mdf4, uff58, tdms, mat, csv, parquet; else by the suffix."),
]
DataType = Annotated[
    str | None,
    typer.Option("--data-type", metavar="TYPE", help="rpc3 only: short_integer (default) or floating_point."),
]


def complete_campaign(incomplete: str) -> list[str]:
    """Return the shipped campaigns with this beginning; the shell completes files itself."""
    from duralab.campaign import shipped_campaigns

    return [name for name in shipped_campaigns() if name.startswith(incomplete)]


def complete_rig(incomplete: str) -> list[str]:
    """Return the shipped rigs with this beginning."""
    from duralab.processes import shipped_rigs

    return [name for name in shipped_rigs() if name.startswith(incomplete)]


RigName = Annotated[
    str, typer.Argument(metavar="RIG", help="Name of the rig, e.g. front_axle.", autocompletion=complete_rig)
]
CampaignId = Annotated[str, typer.Argument(metavar="ID", help="Id of the campaign: the name of its recording.")]


def endpoint_of_lab(given: str | None) -> str:
    """Return the endpoint that is given, or that of the one lab that `duralab up` keeps running; refuse none."""
    if (endpoint := endpoint_if_any(given)) is None:
        raise InputError(
            "None of your labs runs on this machine; start one with `duralab up`, or name one with --connect ENDPOINT.",
            field="connect",
        )
    return endpoint


def endpoint_if_any(given: str | None) -> str | None:
    """Return the endpoint that is given, or that of the one lab that runs; None where none does."""
    if given is not None:
        return given
    from duralab.processes import the_running_lab

    lab = the_running_lab()
    return None if lab is None else lab.endpoint


def require_signal_file(path: Path) -> None:
    """Refuse a file that does not exist, before a lab is started for it."""
    if not path.exists():
        from duralab.near_files import did_you_mean

        raise InputError(f"There is no file {str(path)!r}; give a file of signals{did_you_mean(path)}", field="source")


@contextmanager
def open_lab(
    output: Output,
    endpoint: str | None,
    *,
    rigs: Sequence[str] = (),
    out: Path | None = None,
    viewer: str | None = None,
    recordings: Path | None = None,
    trace_folder: Path | None = None,
    needs_later: Sequence[str | Callable[[], None]] = (),
) -> Iterator[Lab]:
    """Join the lab at an endpoint, or start a private one with these rigs (the usual ones if none are named).

    `needs_later`: Modules to import while a private lab starts.
    """
    from duralab.lab import DEFAULT_RIGS, connect, start
    from duralab.processes import require_shipped

    if endpoint is None:
        require_shipped(rigs, usual=DEFAULT_RIGS)
    with ExitStack() as stack:
        with output.console.status("Joining the lab …" if endpoint is not None else "Starting a private lab …"):
            lab = stack.enter_context(
                connect(endpoint, out=out)
                if endpoint is not None
                else start(
                    out,
                    rigs=tuple(rigs) or DEFAULT_RIGS,
                    viewer=viewer,
                    recordings=recordings,
                    trace_folder=trace_folder,
                    needs_later=needs_later,
                )
            )
        yield lab
