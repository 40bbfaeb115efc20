"""`duralab convert` and `duralab import`: a file of signals in another format, or as the target of a rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from dataclasses import replace as replaced
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import (
    Connect,
    ControllerMapFile,
    DataType,
    FileFormat,
    InputFormat,
    Json,
    Out,
    Replace,
    RunName,
    Source,
    TargetSettings,
    Unit,
    complete_rig,
    endpoint_if_any,
    open_lab,
    require_signal_file,
)
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.data import Signals, StepRecord
    from duralab.formats import Written


def convert(
    source: Source,
    out: Out,
    *,
    from_format: InputFormat = None,
    to_format: FileFormat = None,
    units: Unit = None,
    rate: Annotated[float | None, typer.Option("--rate", metavar="HZ", help="Resample to this rate.")] = None,
    data_type: DataType = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Convert a file of signals to another format, and to other units or another sample rate."""
    from duralab.formats import LEFT_OUT, format_of, read_signals, write_signals
    from duralab.output_files import require_outputs

    # A wrong name or a file in the way is said before a long file is read.
    format_of(out, to_format)
    require_outputs([out], read=[source], replace=replace)
    given = read_signals(source, format=from_format)
    signals = _resampled(in_units(given, units), rate)
    written = write_signals(signals, out, format=to_format, overwrite=replace, data_type=data_type)
    origin = [given.attributes[LEFT_OUT]] if LEFT_OUT in given.attributes else []
    say_written(Output(as_json), signals, written, origin=origin)


def in_units(signals: Signals, units: Sequence[str] | None) -> Signals:
    """Convert to the units given: "SI", a unit for all channels of its dimension, or "<channel>=<unit>"."""
    from duralab.formats import SI_UNITS, convert_units, named_units

    named, plain = named_units(list(units or ()))
    rest = [row for row, channel in enumerate(signals.channels) if channel.name not in named]
    if plain and rest:
        others = replaced(signals, channels=tuple(signals.channels[row] for row in rest), samples=signals.samples[rest])
        converted = convert_units(others, SI_UNITS if plain == ["SI"] else plain)
        named |= {channel.name: channel.unit for channel in converted.channels}
    return convert_units(signals, named) if named else signals


def _resampled(signals: Signals, rate: float | None) -> Signals:
    if rate is None or rate == signals.sample_rate:
        return signals
    if not 0.0 < rate < float("inf"):
        raise InputError(f"--rate is {rate:g}; give a sample rate above 0, in hertz.", field="rate")
    from duralab.target import edit_signals

    try:
        return edit_signals(signals, [{"resample": {"rate": rate}}]).signals
    except InputError as error:
        # There is no campaign file whose place could be named.
        raise InputError(f"--rate is {rate:g}: {str(error).removeprefix(f'{error.field}: ')}", field="rate") from error


def say_written(
    output: Output,
    signals: Signals,
    written: Written,
    *,
    origin: Sequence[str] = (),
    origin_document: Mapping[str, object] | None = None,
) -> None:
    """Print the content of a signal file, the origin of its signals, and losses of its format."""
    import numpy as np

    content = {
        **asdict(written),
        "sample_rate": signals.sample_rate,
        "channels": [{"name": channel.name, "unit": channel.unit} for channel in signals.channels],
        **(origin_document or {}),
    }
    if output.document(content):
        return
    output.say(
        f"{written.path}: {len(signals.channels)} channels, {written.samples} samples at {signals.sample_rate:g} Hz, "
        f"{signals.duration:.6g} s",
        *origin,
        *written.notes,
    )
    if any(written.largest_errors):
        output.say("Largest difference between a sample and what is stored of it:")
        for channel, error, row in zip(signals.channels, written.largest_errors, signals.samples, strict=True):
            peak = float(np.abs(row).max())
            share = f" ({error / peak:.1e} of its peak)" if peak else ""
            output.say(f"  {channel.name}: {error:.3g} {channel.unit}{share}")


def import_file(
    source: Source,
    out: Out,
    *,
    rig: Annotated[
        str | None,
        typer.Option("--rig", metavar="RIG", help="Rig whose responses the target has.", autocompletion=complete_rig),
    ] = None,
    settings: TargetSettings = None,
    controller_map: ControllerMapFile = None,
    run: RunName = None,
    to_format: FileFormat = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Make a target of a measured file, for a rig (--rig); or read the response of a controller to a drive (--map)."""
    from duralab.campaign import ImportSettings, load_import_settings
    from duralab.formats import format_of, write_signals
    from duralab.output_files import require_outputs
    from duralab.target import edit_signals, read_target_file, require_playable

    output = Output(as_json)
    if controller_map is not None:
        for name, value in (("rig", rig), ("settings", settings), ("connect", endpoint)):
            if value is not None:
                raise InputError(f"--{name} is given beside --map, which decides it; leave it out.", field=name)
        format_of(out, to_format)
        require_outputs([out], read=[source, controller_map], replace=replace)
        _import_response(source, out, controller_map, run, to_format=to_format, replace=replace, output=output)
        return
    if rig is None or run is not None:
        raise InputError(
            "--run goes with --map; leave it out."
            if run is not None
            else "--rig is missing; name the rig whose responses the target has, or the --map of its controller.",
            field="rig" if run is None else "run",
        )
    asked = load_import_settings(settings) if settings is not None else ImportSettings()
    # A wrong name or a file in the way is said before a lab is started.
    format_of(out, to_format)
    require_signal_file(source)
    require_outputs([out], read=[source], replace=replace)
    with open_lab(output, endpoint_if_any(endpoint), rigs=(rig,)) as lab:
        described = lab.describe(rig)
    given = read_target_file(source, rig=described, channels=asked.channels, calculated=asked.calculated)
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


def _import_response(
    source: Path,
    out: Path,
    controller_map: Path,
    run: str | None,
    *,
    to_format: str | None,
    replace: bool,
    output: Output,
) -> None:
    from duralab.formats import import_response, write_signals

    found = import_response(source, controller_map, run=run)
    written = write_signals(found.signals, out, format=to_format, overwrite=replace)
    origin = [f"It is the response of run {found.run!r}."]
    document: dict[str, object] = {"run": found.run, "notes_on_response": found.notes, "alignment": None}
    if (alignment := found.alignment) is not None:
        document["alignment"] = asdict(alignment)
        origin.append(
            f"The drive begins {alignment.lag:+.2f} samples from its place; gain of the commands "
            f"{', '.join(f'{gain:.4f}' for gain in alignment.gain)}."
        )
    say_written(output, found.signals, written, origin=[*origin, *found.notes], origin_document=document)


def _document(rig: str, signals: Signals, records: Sequence[StepRecord], written: Written) -> dict[str, object]:
    return {
        **asdict(written),
        "rig": rig,
        "seconds": signals.duration,
        "sample_rate": signals.sample_rate,
        "channels": [{"name": channel.name, "unit": channel.unit} for channel in signals.channels],
        "steps": [{**asdict(record), "finding": record.finding} for record in records],
    }
