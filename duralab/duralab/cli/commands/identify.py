"""`duralab identify`: an experiment on a rig, and what its model is worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.options import Connect, Json, Replace, RigName, complete_campaign
from duralab.cli.output import Output

if TYPE_CHECKING:
    from duralab.data import Model


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
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Random seed; that of FILE if left out.")] = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Identify a rig and show the quality of the model; in a private lab if none runs."""
    from duralab.campaign import load_identification
    from duralab.cli.frf_file import require_frf_file, write_frf
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
            on_progress=display.show,
        )
    output.say(str(model))
    if out is not None:
        write_frf(model, out, replace=replace)
        output.say(f"{out}: the frequency responses")
    output.document(_document(rig, model, out))


def _document(rig: str, model: Model, out: Path | None) -> dict[str, object]:
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
        "verdicts": list(model.verdicts),
        "warnings": list(model.warnings),
        "file": out,
    }
