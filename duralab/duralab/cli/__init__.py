"""The command line; only what a command needs is imported when it runs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.ending import ended_well
from duralab.recorded_result import Result

app = typer.Typer(
    name="duralab",
    help="A durability test lab: start it, run campaigns on its rigs, read what they recorded.",
    epilog="Exit codes: 0 done; 1 the lab or a campaign failed; 2 a wrong value or option; "
    "3 finished, but the target was not reached; 130 interrupted; 143 terminated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Connect = Annotated[
    str | None,
    typer.Option("--connect", metavar="ENDPOINT", help="Use the lab that listens there, e.g. tcp/127.0.0.1:7474."),
]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite outputs that are there.")]


@app.command()
def up(
    listen: Annotated[
        str, typer.Option("--listen", metavar="ENDPOINT", help="Where clients connect.")
    ] = "tcp/127.0.0.1:7474",
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Where recordings and logs go.")
    ] = Path("recordings"),
    rig: Annotated[
        list[str] | None,
        typer.Option("--rig", metavar="NAME", help="A shipped rig to start; give it again for more of them."),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer beside it.")] = False,
) -> None:
    """Start a lab on this machine and keep it running until Ctrl-C."""
    from duralab.cli.lab_commands import run_lab

    with ended_well():
        run_lab(listen=listen, recordings=recordings, rigs=rig, view=view)


@app.command()
def run(
    campaign: Annotated[
        str,
        typer.Argument(help="A campaign file, or a shipped one: front_axle_demo, spindle_coupled_demo, belgian_block."),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where the outputs go; out/<campaign> if left out.")
    ] = None,
    connect: Connect = None,
    view: Annotated[bool, typer.Option("--view", help="Open the live viewer beside it.")] = False,
    replace: Replace = False,
) -> None:
    """Run a campaign to its end, in a lab of its own, or in one that runs already (--connect)."""
    from duralab.cli.run_command import run_campaign

    with ended_well():
        run_campaign(campaign, out=out, endpoint=connect, view=view, replace=replace)


Lab = Annotated[str, typer.Option("--connect", metavar="ENDPOINT", help="Where the lab listens.")]


@app.command()
def resume(
    campaign: Annotated[str, typer.Argument(metavar="ID", help="The campaign, by the name of its recording.")],
    *,
    settings: Annotated[
        str | None,
        typer.Option("--settings", metavar="FILE", help="A campaign file whose `update` and `stop` count from here."),
    ] = None,
    from_iteration: Annotated[
        int, typer.Option("--from", min=0, metavar="N", help="Build on playback N; 0 is the last there is.")
    ] = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where the outputs go; out/<campaign> if left out.")
    ] = None,
    connect: Lab = "tcp/127.0.0.1:7474",
    replace: Replace = False,
) -> None:
    """Go on with a campaign that was broken off, or take one up again, possibly with other settings."""
    from duralab.cli.resume_command import resume as go_on

    with ended_well():
        go_on(campaign, endpoint=connect, settings=settings, from_iteration=from_iteration, out=out, replace=replace)


@app.command()
def stop(
    campaign: Annotated[str, typer.Argument(metavar="ID", help="The campaign, by the name of its recording.")],
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; kept in the recording.")] = "",
    connect: Lab = "tcp/127.0.0.1:7474",
) -> None:
    """Stop a campaign; the rig ramps down and is latched where it plays."""
    from duralab.cli.resume_command import stop as end

    with ended_well():
        end(campaign, endpoint=connect, reason=reason)


@app.command()
def report(
    recording: Annotated[Path, typer.Argument(help="A recording.mcap.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The HTML file; report.html beside it if left out.")
    ] = None,
    replace: Replace = False,
) -> None:
    """Write the report of a recording: one HTML file that opens offline."""
    from duralab.cli.report_command import write

    with ended_well():
        write(recording, out=out, replace=replace)


@app.command()
def catalogue(
    *,
    rig: Annotated[str, typer.Option("--rig", metavar="NAME", help="Only recordings on this rig.")] = "",
    target: Annotated[
        str, typer.Option("--target", metavar="TEXT", help="Only those whose target's source holds this text.")
    ] = "",
    begun_from: Annotated[datetime | None, typer.Option("--from", help="Only those begun then or later.")] = None,
    begun_before: Annotated[datetime | None, typer.Option("--before", help="Only those begun before.")] = None,
    result: Annotated[Result | None, typer.Option("--result", help="Only those that ended so.")] = None,
    connect: Lab = "tcp/127.0.0.1:7474",
    as_json: Annotated[bool, typer.Option("--json", help="Print the recordings as JSON.")] = False,
) -> None:
    """List the recordings of a lab, all or those that are looked for."""
    from duralab.cli.catalogue_command import list_recordings

    with ended_well():
        list_recordings(
            endpoint=connect,
            rig=rig,
            target=target,
            begun_from=begun_from,
            begun_before=begun_before,
            result=result,
            as_json=as_json,
        )


@app.command()
def verify(
    recording: Annotated[str, typer.Argument(metavar="ID", help="The recording; it is not written any more.")],
    connect: Lab = "tcp/127.0.0.1:7474",
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Read a recording from end to end: checksums, hashes, steps, signal blocks and the chain of its files."""
    from duralab.cli.catalogue_command import verify as check_recording

    with ended_well():
        check_recording(recording, endpoint=connect, as_json=as_json)


@app.command()
def rigs(connect: Connect = None) -> None:
    """List the rigs with their channels, limits and sample rates, and what else is shipped."""
    from duralab.cli.lab_commands import list_rigs

    with ended_well():
        list_rigs(endpoint=connect)


@app.command()
def reset(
    rig: Annotated[str, typer.Argument(help="Name of the rig, e.g. front_axle.")],
    connect: Lab = "tcp/127.0.0.1:7474",
) -> None:
    """Clear the latch of an interlocked rig, after the reason is dealt with."""
    from duralab.cli.reset_command import reset as clear

    with ended_well():
        clear(rig, endpoint=connect)


@app.command()
def check_rig(
    rig: Annotated[str, typer.Argument(help="Name of the rig, e.g. front_axle.")],
    connect: Connect = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check that a rig keeps the contract; it is moved by 5 % of its limits, twice for 2 s, stopped and reset."""
    from duralab.cli.check_rig_command import check

    with ended_well():
        check(rig, endpoint=connect, as_json=as_json)


@app.command()
def view(
    file: Annotated[Path | None, typer.Argument(help="A live.rrd, or a recording.mcap to make one of.")] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Where data are sent to it.")] = 9876,
    web_port: Annotated[int, typer.Option("--web-port", min=0, max=65535, help="Where a browser finds it.")] = 9090,
    web: Annotated[bool, typer.Option("--web", help="A page for the browser, even where there is a display.")] = False,
) -> None:
    """Open the Rerun viewer on 127.0.0.1, in a window or as a page for the browser, until Ctrl-C."""
    from duralab.cli.lab_commands import run_viewer

    with ended_well():
        run_viewer(file, port=port, web_port=web_port, web=web)


def main() -> None:
    """Run the command line."""
    app()
