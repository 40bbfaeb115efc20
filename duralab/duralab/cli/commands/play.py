"""`duralab play` and `duralab identify`: one motion of a rig."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import (
    Connect,
    Json,
    RealTime,
    Replace,
    RigName,
    Seed,
    complete_campaign,
    endpoint_if_any,
    open_lab,
    require_signal_file,
)
from duralab.cli.output import Output

if TYPE_CHECKING:
    from duralab.data import Model, Played
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
    from duralab.formats import LEFT_OUT, format_of, write_signals
    from duralab.lab import Stage, read_drive_file
    from duralab.output_files import require_outputs

    output = Output(as_json)
    path = out or drive.with_name(f"{drive.stem}_response.csv")
    format_of(path, None)
    require_outputs([path], read=[drive], replace=replace)
    # Before a lab is started: a private one takes seconds.
    require_signal_file(drive)
    with open_lab(output, endpoint_if_any(endpoint), rigs=(rig,)) as lab:
        signals = read_drive_file(drive, lab.describe(rig), units=units or [])
        with RunDisplay(output.console, stages=(Stage.PLAYBACK,)) as display:
            played = lab.play(rig, signals, seed=seed, real_time=real_time, on_progress=display.show)
    written = write_signals(played.response, path, overwrite=replace)
    notes = [signals.attributes[LEFT_OUT]] if LEFT_OUT in signals.attributes else []
    notes += written.notes
    what = f"{path}: {played.response.duration:g} s of {len(played.response.channels)} responses"
    output.say(str(played), what, *notes)
    output.document(_response_document(rig, played, written, notes))


def _response_document(rig: str, played: Played, written: Written, notes: list[str]) -> dict[str, object]:
    import numpy as np

    response = played.response
    return {
        "rig": rig,
        "run": played.run,
        "response": written.path,
        "format": written.format,
        "notes": notes,
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


def identify(
    rig: RigName,
    settings: Annotated[
        str,
        typer.Option(
            "--settings",
            metavar="FILE",
            help="YAML with `excitation` and `estimator`: a campaign, its file, or one of these sections only.",
            autocompletion=complete_campaign,
        ),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the frequency responses, into .uff or .unv.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", min=0, help="Random seed; that of FILE if left out.")
    ] = None,
    drive_map: Annotated[
        bool, typer.Option("--drive-map", help="Learn which drives follow products of others, as a campaign does.")
    ] = False,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Identify a rig and show the quality of the model; in a private lab if none runs."""
    from duralab.campaign import load_identification
    from duralab.cli.commands.export import require_frf_file, write_frf
    from duralab.cli.run_display import RunDisplay
    from duralab.lab import Stage
    from duralab.output_files import require_outputs

    output = Output(as_json)
    asked = load_identification(settings)
    if out is not None:
        require_frf_file(out)
        require_outputs([out], replace=replace)
    with (
        open_lab(output, endpoint_if_any(endpoint), rigs=(rig,)) as lab,
        RunDisplay(output.console, stages=(Stage.IDENTIFICATION,)) as display,
    ):
        model = lab.identify(
            rig,
            asked.excitation,
            asked.estimator,
            seed=asked.seed if seed is None else seed,
            learn_drive_map=drive_map,
            on_progress=display.show,
        )
    output.say(str(model))
    if asked.excitation.at_target is not None:
        output.say("excitation.at_target is not played here: it needs a target, which a campaign has.")
    if out is not None:
        write_frf(model, out, replace=replace)
        output.say(f"{out}: the frequency responses")
    output.document(_model_document(rig, model, out))


def _model_document(rig: str, model: Model, out: Path | None) -> dict[str, object]:
    import numpy as np

    known = np.isfinite(model.coherence).all(axis=1)
    return {
        "rig": rig,
        "model": model.id,
        "lines": int(known.sum()),
        "lowest_frequency": model.frequency[known].min() if known.any() else None,
        "highest_frequency": model.frequency[known].max() if known.any() else None,
        "independent_averages": model.independent_averages,
        "responses": [
            {
                "name": channel.name,
                "median_coherence": float(np.median(model.coherence[known, column])) if known.any() else None,
            }
            for column, channel in enumerate(model.responses)
        ],
        "drive_map": list(model.drive_map),
        "verdicts": list(model.verdicts),
        "warnings": list(model.warnings),
        "file": out,
    }
