"""`duralab import`: a measured file as the target of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.options import Connect, FileFormat, Json, Out, Replace, Source, complete_rig
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.data import Signals, StepRecord
    from duralab.formats import Written


def import_file(
    source: Source,
    out: Out,
    *,
    rig: Annotated[
        str,
        typer.Option("--rig", metavar="RIG", help="Rig whose responses the target has.", autocompletion=complete_rig),
    ],
    settings: Annotated[
        Path | None,
        typer.Option(
            "--settings", metavar="FILE", help="YAML with `channels` and `edit`, as under `target` of a campaign file."
        ),
    ] = None,
    to_format: FileFormat = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Make a target of a measured file: its channels as responses of a rig, in their units, edited step by step."""
    from duralab.campaign import ImportSettings, load_import_settings
    from duralab.formats import format_of, write_signals
    from duralab.near_files import did_you_mean
    from duralab.output_files import require_outputs
    from duralab.target import edit_signals, read_target_file, require_playable

    output = Output(as_json)
    asked = load_import_settings(settings) if settings is not None else ImportSettings()
    # A wrong name or a file in the way is said before a lab is started.
    format_of(out, to_format)
    if not source.is_file():
        raise InputError(
            f"There is no file {str(source)!r}; give a file of signals{did_you_mean(source)}", field="source"
        )
    require_outputs([out], read=[source], replace=replace)
    with open_lab(output, endpoint_if_any(endpoint), rigs=(rig,)) as lab:
        described = lab.describe(rig)
    given = read_target_file(source, rig=described, channels=asked.channels)
    edited = edit_signals(given.signals, asked.edit)
    records = (*given.records, *edited.records)
    require_playable(edited.signals, rig=described)
    written = write_signals(edited.signals, out, format=to_format, overwrite=replace)
    signals = edited.signals
    output.say(
        *(f"{record.name}: {record.finding}" for record in records),
        f"{out}: {len(signals.channels)} responses of {rig}, {signals.duration:.6g} s at {signals.sample_rate:g} Hz; "
        f"in a campaign, `target: {{file: {out}}}`.",
        *written.notes,
    )
    output.document(_document(rig, signals, records, written))


def _document(rig: str, signals: Signals, records: Sequence[StepRecord], written: Written) -> dict[str, object]:
    return {
        **asdict(written),
        "rig": rig,
        "seconds": signals.duration,
        "sample_rate": signals.sample_rate,
        "channels": [{"name": channel.name, "unit": channel.unit} for channel in signals.channels],
        "steps": [{**asdict(record), "finding": record.finding} for record in records],
    }
