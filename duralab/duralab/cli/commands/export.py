"""`duralab export`: signals or frequency responses out of a recording into a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from dataclasses import replace as replaced
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.commands.convert import in_units, say_written
from duralab.cli.options import ControllerMapFile, DataType, FileFormat, Json, Replace, RunName, Unit
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.data import Model, Signals
    from duralab.recording import Recording


class Exported(StrEnum):
    """Data that a recording can export."""

    TARGET = "target"
    TARGET_IN_BAND = "target_in_band"
    DRIVE = "drive"
    RESPONSE = "response"
    RESPONSE_IN_BAND = "response_in_band"
    FRF = "frf"


def export(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A recording.mcap; with --map, or a drive file.")],
    out: Annotated[Path | None, typer.Argument(metavar="OUT", help="The file to write; not with --map.")] = None,
    *,
    what: Annotated[
        str,
        typer.Option(
            "--what",
            metavar="SIGNALS",
            help="drive; target or response, whole or as _in_band; or frf (into .uff or .unv).",
        ),
    ] = "drive",
    playback: Annotated[
        int | None, typer.Option("--playback", metavar="N", help="Number of the playback; the best if left out.")
    ] = None,
    to_format: FileFormat = None,
    units: Unit = None,
    data_type: DataType = None,
    controller_map: ControllerMapFile = None,
    run: RunName = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write signals or frequency responses of a recording into a file; with --map, a drive for a rig's controller."""
    from duralab.formats import Format, format_of, write_signals
    from duralab.output_files import require_other
    from duralab.recording import open_recording

    output = Output(as_json)
    try:
        chosen = Exported(what)
    except ValueError:
        raise InputError(f"--what is {what!r}; {', '.join(Exported)} are known.", field="what") from None
    if controller_map is not None:
        refuse_beside_map(out=out, unit=units, format=to_format, data_type=data_type, replace=replace or None)
        if chosen is not Exported.DRIVE:
            raise InputError(f"--what is {what}; a controller takes a drive, so leave it out.", field="what")
        _export_for_controller(source, controller_map, run, playback=playback, output=output)
        return
    if out is None or run is not None:
        raise InputError(
            "--run goes with --map; leave it out." if run is not None else "OUT is missing; give the file to write.",
            field="out" if run is None else "run",
        )
    opened = open_recording(source)
    require_other([out], read=opened.files)
    if chosen is Exported.FRF:
        _refuse_for_frf(playback=playback, unit=units or [], format=to_format, data_type=data_type)
        _export_frf(opened, out, replace=replace)
        if not output.document({"path": out, "format": "uff58", **_origin_document(opened, None)}):
            output.say(f"{out}: the frequency responses", *_origin(opened, None))
        return
    taken = _playback_taken(opened, chosen, playback)
    signals = in_units(_recorded(opened, chosen, taken), units)
    if format_of(out, to_format) is Format.RPC3 and chosen is Exported.DRIVE:
        signals = replaced(signals, attributes={"TIME_TYPE": "DRIVE"})
    written = write_signals(signals, out, format=to_format, overwrite=replace, data_type=data_type)
    say_written(
        output,
        signals,
        written,
        origin=list(_origin(opened, taken)),
        origin_document=_origin_document(opened, taken),
    )


def _export_for_controller(
    source: Path, controller_map: Path, run: str | None, *, playback: int | None, output: Output
) -> None:
    from duralab.formats import LEFT_OUT, export_drive, read_signals
    from duralab.recording import open_recording

    origin: Iterable[str] = ()
    if source.suffix.lower() == ".mcap":
        opened = open_recording(source)
        taken = _playback_taken(opened, Exported.DRIVE, playback)
        drive, run = _recorded(opened, Exported.DRIVE, taken), run or f"{source.resolve().parent.name}_{taken}"
        origin = _origin(opened, taken)
    elif playback is not None:
        raise InputError(f"--playback is {playback}; {source} is no recording, so leave it out.", field="playback")
    else:
        drive, run = read_signals(source), run or source.stem
    written = export_drive(drive, controller_map, run=run)
    notes = (*([drive.attributes[LEFT_OUT]] if LEFT_OUT in drive.attributes else []), *written.notes)
    order = written.order
    seconds = order.samples / order.sample_rate
    if output.document({"path": written.path, "page": written.page, "notes": notes, **asdict(order)}):
        return
    output.say(
        f"{written.path}: {order.samples} samples at {order.sample_rate:g} Hz, {seconds:.6g} s",
        *origin,
        *notes,
        *(
            f"  {channel.name}: peak {channel.peak:.4g} {channel.unit}, {100 * share:.0f} % of its limit; "
            f"full scale {channel.full_scale:g} {channel.unit}"
            for channel, share in zip(order.channels, written.limit_shares, strict=True)
        ),
        f"What to set and to record is in {written.page}; the run waits for inbox/{order.response_file}.",
    )


def refuse_beside_map(**options: object) -> None:
    """Refuse options whose values the map of a controller gives."""
    for name, value in options.items():
        if value is not None:
            word = "OUT" if name == "out" else f"--{name.replace('_', '-')}"
            raise InputError(f"{word} is given beside --map, which decides it; leave it out.", field=name)


def _playback_taken(recording: Recording, what: Exported, asked: int | None) -> int | None:
    if what in (Exported.TARGET, Exported.TARGET_IN_BAND):
        if asked is not None:
            raise InputError(f"--playback is {asked}; there is one target, so leave it out.", field="playback")
        return None
    table = recording.iterations
    if not table.numbers:
        raise InputError(
            f"{recording.path} holds no playback of a campaign; export its target, or give a recording that has one."
        )
    return table.numbers[table.best] if asked is None else asked


def _recorded(recording: Recording, what: Exported, playback: int | None) -> Signals:
    if what is Exported.TARGET:
        from duralab.data import Signals

        return Signals.from_message(recording.specification.target, field="target")
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
            given = " ".join(map(str, value)) if isinstance(value, list) else value
            raise InputError(
                f"--{name.replace('_', '-')} is {given}; the frequency responses are the model's and are written as "
                "they are, so leave it out.",
                field=name,
            )


def _export_frf(recording: Recording, out: Path, *, replace: bool) -> None:
    require_frf_file(out)
    if recording.model is None:
        raise InputError(
            f"{recording.path} holds no model, as its rig was not identified; give a recording that has one."
        )
    write_frf(recording.model, out, replace=replace)


def _origin(recording: Recording, playback: int | None) -> Iterator[str]:
    """Yield where the exported data come from: the playback (None if they belong to no single one), what is missing."""
    from duralab.campaign import Judgement

    table, verdict = recording.iterations, recording.verdict
    if playback is not None:
        row = table.numbers.index(playback)
        level = "" if table.level[row] == 1.0 else f", at {table.level[row]:g} of the target"
        yield (
            f"It is playback {playback} of {len(table)} in the recording{level}; its relative RMS error over "
            f"all channels is {table.overall[row]:.3f}."
        )
        if row == table.best:
            yield "It is the best playback."
        else:
            yield f"The best is playback {table.numbers[table.best]} with {table.overall[table.best]:.3f}."
    if not recording.whole:
        yield f"{recording.path} was never finished: what came after its last whole step is not in it."
    if verdict.judgement is Judgement.ENDED_EARLY or (
        playback is not None and verdict.judgement is not Judgement.REACHED
    ):
        yield verdict.sentence


def _origin_document(recording: Recording, playback: int | None) -> dict[str, object]:
    table, verdict = recording.iterations, recording.verdict
    row = None if playback is None else table.numbers.index(playback)
    return {
        "playback": playback,
        "overall_error": None if row is None else table.overall[row],
        "level": None if row is None else table.level[row],
        "playbacks": table.numbers,
        "best_playback": table.numbers[table.best] if table.numbers else None,
        "judgement": verdict.judgement.value,
        "verdict": verdict.sentence,
        "recording_finished": recording.whole,
    }


def require_frf_file(path: Path) -> None:
    """Refuse a file that cannot hold a frequency response; raises InputError."""
    from duralab.formats import Format, format_of

    if format_of(path, None) is not Format.UFF58:
        raise InputError(f"{path} cannot hold a frequency response; give a file that ends in .uff or .unv.")


def write_frf(model: Model, path: Path, *, replace: bool) -> None:
    """Write the frequency responses of a model; lines at both ends that were not excited are left out."""
    import numpy as np

    from duralab.formats import FrequencyResponse, write_frequency_response
    from duralab.output_files import replace_when_complete, require_outputs

    # Lines without excitation hold NaN; those at both ends are cut off, one in between is an error.
    known = np.flatnonzero(np.isfinite(model.frf).all(axis=(1, 2)))
    if known.size == 0:
        raise InputError(f"{path} is not written: the model holds no line that was identified; identify again.")
    lines = slice(int(known[0]), int(known[-1]) + 1)
    response = FrequencyResponse(model.drives, model.responses, model.frequency[lines], model.frf[lines])
    require_outputs([path], replace=replace)
    with replace_when_complete(path) as temporary:
        write_frequency_response(response, temporary)
