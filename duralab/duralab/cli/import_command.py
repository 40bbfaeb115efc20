"""`duralab import`: a measured file as the target of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from duralab.campaign import ImportSettings, load_import_settings
from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.json_output import console_beside, write_json
from duralab.data import Signals, StepRecord
from duralab.errors import InputError
from duralab.formats import Written, format_of, write_signals
from duralab.near_files import did_you_mean
from duralab.output_files import require_free, require_other
from duralab.target import edit_signals, read_target_file, require_playable


def import_target(
    source: Path,
    out: Path,
    *,
    rig: str,
    settings: Path | None,
    to_format: str | None,
    endpoint: str | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Map the channels of a file to a rig's responses, edit them, write the target, and tell what each step did."""
    console = console_beside(as_json)
    asked = load_import_settings(settings) if settings is not None else ImportSettings()
    # A wrong name or a file in the way is said before a lab is started.
    format_of(out, to_format)
    if not source.is_file():
        raise InputError(
            f"There is no file {str(source)!r}; give a file of signals{did_you_mean(source)}", field="source"
        )
    require_other([out], read=[source])
    require_free([out], replace=replace)
    endpoint = endpoint_if_any(endpoint)
    waiting = "Asking the lab …" if endpoint is not None else "Starting a lab of its own to ask …"
    with console.status(waiting), open_lab(endpoint, rigs=(rig,)) as lab:
        described = lab.describe(rig)
    given = read_target_file(source, rig=described, channels=asked.channels)
    edited = edit_signals(given.signals, asked.edit)
    records = (*given.records, *edited.records)
    require_playable(edited.signals, rig=described)
    written = write_signals(edited.signals, out, format=to_format, overwrite=replace)
    for record in records:
        console.print(f"{record.name}: {record.finding}", highlight=False, markup=False)
    signals = edited.signals
    console.print(
        f"{out}: {len(signals.channels)} responses of {rig}, {signals.duration:.6g} s at {signals.sample_rate:g} Hz; "
        f"in a campaign, `target: {{file: {out}}}`.",
        highlight=False,
        markup=False,
    )
    for note in written.notes:
        console.print(note, highlight=False, markup=False)
    if as_json:
        write_json(_document(rig, edited.signals, records, written))


def _document(rig: str, signals: Signals, records: Sequence[StepRecord], written: Written) -> dict[str, object]:
    return {
        **asdict(written),
        "rig": rig,
        "seconds": signals.duration,
        "sample_rate": signals.sample_rate,
        "channels": [{"name": channel.name, "unit": channel.unit} for channel in signals.channels],
        "steps": [{**asdict(record), "finding": record.finding} for record in records],
    }
