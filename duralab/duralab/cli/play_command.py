"""`duralab play`: a drive file on a rig, and its response into a file."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import numpy as np

from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.run_display import RunDisplay
from duralab.data import Played
from duralab.formats import Written, format_of, write_signals
from duralab.lab import Stage, read_drive_file
from duralab.output_files import require_free, require_other


def play(
    rig: str,
    drive: Path,
    *,
    out: Path | None,
    units: list[str],
    seed: int,
    real_time: bool,
    endpoint: str | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Play a drive file and write the response; nothing moves where the response could not be written."""
    console = console_beside(as_json)
    path = out or drive.with_name(f"{drive.stem}_response.csv")
    format_of(path, None)
    require_other([path], read=[drive])
    require_free([path], replace=replace)
    endpoint = endpoint_if_any(endpoint)
    with ExitStack() as stack:
        with console.status("Joining the lab …" if endpoint is not None else "Starting a lab of its own …"):
            lab = stack.enter_context(open_lab(endpoint, rigs=(rig,)))
        signals = read_drive_file(drive, lab.describe(rig), units=units)
        with RunDisplay(console, stages=(Stage.PLAYBACK,)) as display:
            played = lab.play(rig, signals, seed=seed, real_time=real_time, on_progress=display.show)
    written = write_signals(played.response, path, overwrite=replace)
    console.print(str(played), highlight=False, markup=False)
    for line in (
        f"{path}: {played.response.duration:g} s of {len(played.response.channels)} responses",
        *written.notes,
    ):
        console.print(line, highlight=False, markup=False)
    if as_json:
        write_json(_document(rig, played, written))


def _document(rig: str, played: Played, written: Written) -> dict[str, object]:
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
