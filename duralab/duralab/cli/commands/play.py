"""`duralab play`: a drive file on a rig, and its response into a file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.options import Connect, Json, RealTime, Replace, RigName, Seed
from duralab.cli.output import Output

if TYPE_CHECKING:
    from duralab.data import Played
    from duralab.formats import Written


def play(
    rig: RigName,
    drive: Annotated[Path, typer.Argument(metavar="DRIVEFILE", help="The drive: a file of signals of any format.")],
    *,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File for the response; <DRIVEFILE>_response.csv if left out."),
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="UNIT",
            help="Unit of the drives without one in DRIVEFILE; or CHANNEL=UNIT, which overrides it; repeatable.",
        ),
    ] = None,
    seed: Seed = 0,
    real_time: RealTime = False,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Play a drive file on a rig and write its response; in a private lab if none runs."""
    from duralab.cli.run_display import RunDisplay
    from duralab.formats import format_of, write_signals
    from duralab.lab import Stage, read_drive_file
    from duralab.output_files import require_outputs

    output = Output(as_json)
    path = out or drive.with_name(f"{drive.stem}_response.csv")
    format_of(path, None)
    require_outputs([path], read=[drive], replace=replace)
    with open_lab(output, endpoint_if_any(endpoint), rigs=(rig,)) as lab:
        signals = read_drive_file(drive, lab.describe(rig), units=units or [])
        with RunDisplay(output.console, stages=(Stage.PLAYBACK,)) as display:
            played = lab.play(rig, signals, seed=seed, real_time=real_time, on_progress=display.show)
    written = write_signals(played.response, path, overwrite=replace)
    what = f"{path}: {played.response.duration:g} s of {len(played.response.channels)} responses"
    output.say(str(played), what, *written.notes)
    output.document(_document(rig, played, written))


def _document(rig: str, played: Played, written: Written) -> dict[str, object]:
    import numpy as np

    response = played.response
    return {
        "rig": rig,
        "run": played.run,
        "response": written.path,
        "format": written.format,
        "notes": list(written.notes),
        "seconds": response.duration,
        "sample_rate": response.sample_rate,
        "real_time_factor": played.real_time_factor,
        "channels": [
            {
                "name": channel.name,
                "unit": channel.unit,
                "rms": float(np.sqrt(np.mean(np.square(row)))),
                "peak": float(np.abs(row).max()),
            }
            for channel, row in zip(response.channels, response.samples, strict=True)
        ],
        "actuators": [asdict(use) for use in played.actuators],
    }
