"""`duralab convert` and `duralab export`: signals from one file format into another, and out of a recording."""

from __future__ import annotations

from dataclasses import asdict
from dataclasses import replace as replaced
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from duralab.cli.json_output import write_json
from duralab.data import Signals
from duralab.errors import InputError
from duralab.output_files import require_free, require_other

if TYPE_CHECKING:
    from duralab.cli.export_origin import Origin
    from duralab.formats import Written
    from duralab.recording import Recording


class Exported(StrEnum):
    """What a recording can give."""

    TARGET = "target"
    DRIVE = "drive"
    RESPONSE = "response"
    RESPONSE_IN_BAND = "response_in_band"
    FRF = "frf"


def convert(
    source: Path,
    out: Path,
    *,
    from_format: str | None,
    to_format: str | None,
    units: list[str],
    rate: float | None,
    data_type: str | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Read a file, convert it as asked for, write it, and say what the new one could not keep."""
    from duralab.formats import format_of, read_signals, write_signals

    require_other([out], read=[source])
    # A wrong name or a file in the way is said before a long file is read.
    format_of(out, to_format)
    require_free([out], replace=replace)
    signals = _resampled(_in_units(read_signals(source, format=from_format), units), rate)
    written = write_signals(signals, out, format=to_format, overwrite=replace, data_type=data_type)
    _say(signals, written, as_json=as_json)


def export(
    recording: Path,
    out: Path,
    *,
    what: str,
    playback: int | None,
    to_format: str | None,
    units: list[str],
    data_type: str | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Write what a recording holds into a file."""
    from duralab.cli.export_origin import Origin
    from duralab.formats import Format, format_of, write_signals
    from duralab.recording import open_recording

    try:
        chosen = Exported(what)
    except ValueError:
        raise InputError(f"--what is {what!r}; {', '.join(Exported)} are known.", field="what") from None
    opened = open_recording(recording)
    require_other([out], read=opened.files)
    if chosen is Exported.FRF:
        _refuse_for_frf(playback=playback, unit=units, format=to_format, data_type=data_type)
        _export_frf(opened, out, replace=replace)
        _say_frf(out, Origin(opened, playback=None), as_json=as_json)
        return
    taken = _playback_taken(opened, chosen, playback)
    signals = _in_units(_recorded(opened, chosen, taken), units)
    if format_of(out, to_format) is Format.RPC3 and chosen is Exported.DRIVE:
        signals = replaced(signals, attributes={"TIME_TYPE": "DRIVE"})
    written = write_signals(signals, out, format=to_format, overwrite=replace, data_type=data_type)
    _say(signals, written, origin=Origin(opened, playback=taken), as_json=as_json)


def _playback_taken(recording: Recording, what: Exported, asked: int | None) -> int | None:
    if what is Exported.TARGET:
        if asked is not None:
            raise InputError(f"--playback is {asked}; there is one target, so leave it out.", field="playback")
        return None
    table = recording.iterations
    if not table.numbers:
        raise InputError(f"{recording.path} holds no playback.")
    return table.numbers[table.best] if asked is None else asked


def _recorded(recording: Recording, what: Exported, playback: int | None) -> Signals:
    if playback is None:
        return recording.target
    taken = recording.playback(playback)
    return {
        Exported.DRIVE: taken.drive,
        Exported.RESPONSE: taken.response,
        Exported.RESPONSE_IN_BAND: taken.response_in_band,
    }[what]


def _refuse_for_frf(**options: object) -> None:
    """Refuse options that say how signals are written: nothing of the kind is done to frequency responses."""
    for name, value in options.items():
        if value not in (None, []):
            told = " ".join(map(str, value)) if isinstance(value, list) else value
            raise InputError(
                f"--{name.replace('_', '-')} is {told}; the frequency responses are the model's and are written as "
                "they are, so leave it out.",
                field=name,
            )


def _export_frf(recording: Recording, out: Path, *, replace: bool) -> None:
    from duralab.cli.frf_file import require_frf_file, write_frf

    require_frf_file(out)
    if recording.model is None:
        raise InputError(f"{recording.path} holds no model; the campaign did not come so far.")
    write_frf(recording.model, out, replace=replace)


def _in_units(signals: Signals, units: list[str]) -> Signals:
    """Convert to the units given: "SI", a unit for all channels of its dimension, or "<channel>=<unit>"."""
    from duralab.formats import SI_UNITS, convert_units, named_units

    named, plain = named_units(units)
    rest = [row for row, channel in enumerate(signals.channels) if channel.name not in named]
    if plain and rest:
        others = replaced(signals, channels=tuple(signals.channels[row] for row in rest), samples=signals.samples[rest])
        converted = convert_units(others, SI_UNITS if plain == ["SI"] else plain)
        named |= {channel.name: channel.unit for channel in converted.channels}
    return convert_units(signals, named) if named else signals


def _resampled(signals: Signals, rate: float | None) -> Signals:
    if rate is None or rate == signals.sample_rate:
        return signals
    from duralab.target import edit_signals

    return edit_signals(signals, [{"resample": {"rate": rate}}]).signals


def _say(signals: Signals, written: Written, *, origin: Origin | None = None, as_json: bool) -> None:
    if as_json:
        content = {
            **asdict(written),
            "sample_rate": signals.sample_rate,
            "channels": [{"name": channel.name, "unit": channel.unit} for channel in signals.channels],
            **({} if origin is None else origin.document()),
        }
        write_json(content)
        return
    console = Console(soft_wrap=True)
    lines = [
        f"{written.path}: {len(signals.channels)} channels, {written.samples} samples at {signals.sample_rate:g} Hz, "
        f"{signals.duration:.6g} s",
        *(() if origin is None else origin.lines()),
        *written.notes,
    ]
    if any(written.largest_errors):
        lines.append("Largest difference between a sample and what is stored of it:")
        for channel, error, row in zip(signals.channels, written.largest_errors, signals.samples, strict=True):
            peak = float(np.abs(row).max())
            share = f" ({error / peak:.1e} of its peak)" if peak else ""
            lines.append(f"  {channel.name}: {error:.3g} {channel.unit}{share}")
    for line in lines:
        console.print(line, highlight=False, markup=False)


def _say_frf(out: Path, origin: Origin, *, as_json: bool) -> None:
    if as_json:
        write_json({"path": out, "format": "uff58", **origin.document()})
        return
    for line in (f"{out}: the frequency responses", *origin.lines()):
        Console(soft_wrap=True).print(line, highlight=False, markup=False)
