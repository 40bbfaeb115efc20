"""`duralab identify`: an experiment on a rig, and what its model is worth."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from duralab.campaign import load_identification
from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.frf_file import require_frf_file, write_frf
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.run_display import RunDisplay
from duralab.data import Model
from duralab.lab import Stage
from duralab.output_files import require_free


def identify(
    rig: str,
    *,
    settings: str,
    out: Path | None,
    seed: int | None,
    endpoint: str | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Identify a rig; nothing moves where the model could not be written."""
    console = console_beside(as_json)
    asked = load_identification(settings)
    if out is not None:
        require_frf_file(out)
        require_free([out], replace=replace)
    endpoint = endpoint_if_any(endpoint)
    with ExitStack() as stack:
        with console.status("Joining the lab …" if endpoint is not None else "Starting a lab of its own …"):
            lab = stack.enter_context(open_lab(endpoint, rigs=(rig,)))
        with RunDisplay(console, stages=(Stage.IDENTIFICATION,)) as display:
            model = lab.identify(
                rig,
                asked.excitation,
                asked.estimator,
                seed=asked.seed if seed is None else seed,
                on_progress=display.show,
            )
    console.print(str(model), highlight=False, markup=False)
    if out is not None:
        write_frf(model, out, replace=replace)
        console.print(f"{out}: the frequency responses", highlight=False, markup=False)
    if as_json:
        write_json(_document(rig, model, out))


def _document(rig: str, model: Model, out: Path | None) -> dict[str, object]:
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
