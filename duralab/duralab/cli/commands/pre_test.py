"""`duralab pre-test`: what is wrong with the channels of a rig, before a campaign moves it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Connect, Json, RealTime, RigName, endpoint_if_any, open_lab
from duralab.cli.output import Output


def pre_test(
    rig: RigName,
    *,
    level: Annotated[
        float, typer.Option("--level", metavar="SHARE", help="Largest share of the limits, up to 0.05.")
    ] = 0.05,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Seed of the random parts of a simulated rig.")
    ] = 0,
    real_time: RealTime = False,
    recordings: Annotated[
        Path, typer.Option("--recordings", metavar="DIR", help="Folder for the recording, in a private lab.")
    ] = Path("recordings"),
    endpoint: Connect = None,
    as_json: Json = False,
) -> None:
    """Check the channels of a rig by small pulses on each drive, within 5 % of its limits; keep a recording."""
    from duralab.cli.run_display import RunDisplay
    from duralab.lab import Stage

    output = Output(as_json)
    with (
        open_lab(output, endpoint_if_any(endpoint), rigs=(rig,), recordings=recordings) as lab,
        RunDisplay(output.console, stages=(Stage.PRE_TEST,)) as display,
    ):
        found = lab.pre_test(rig, level=level, seed=seed, real_time=real_time, on_progress=display.show)
    output.say(str(found))
    output.document(
        {
            "rig": found.rig,
            "recording": found.id,
            "passed": found.passed,
            "findings": [asdict(finding) for finding in found.findings],
            "expectations": found.expectations,
            "drives": [
                {"name": channel.name, "unit": channel.unit, "amplitude": peak}
                for channel, peak in zip(found.drives, found.amplitude, strict=True)
            ],
            "responses": [
                {
                    "name": channel.name,
                    "unit": channel.unit,
                    **{name: getattr(found, name)[row] for name in ("offset", "noise", "peak", "lag", "gain")},
                }
                for row, channel in enumerate(found.responses)
            ],
        }
    )
    if not found.passed:
        raise typer.Exit(int(ExitCode.FAILED))
