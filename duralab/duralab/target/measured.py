"""Reading of a measured target: from the channels of a file to the responses of a rig."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from duralab.campaign import SourceChannel
from duralab.data import READ_FILE, ChannelRecord, Rig, Signals, SourceRecord, StepRecord
from duralab.errors import InputError
from duralab.target.editing import EditedTarget
from duralab_gateway import CalculatedChannel
from duralab_settings import dump_yaml


def read_target_file(
    path: Path,
    *,
    rig: Rig,
    channels: Mapping[str, SourceChannel],
    watched: Collection[str] = (),
    calculated: Sequence[CalculatedChannel] = (),
) -> EditedTarget:
    """Read a target from a file of any format of `duralab.formats`.

    Parameters
    ----------
    path : Path
        Path of the file.
    rig : Rig
        Rig with the responses.
    channels : mapping of str to SourceChannel
        Channel of the file for each response; a response that is not listed follows the channel with its name.
    watched : collection of str
        Monitored responses, which may be missing in the file; then their target is zero.
    calculated : sequence of CalculatedChannel
        Channels calculated from those of the file; a response can follow them like any other.

    Returns
    -------
    EditedTarget
        All responses of the rig in its order and units, at the file's sample rate, with a record of the reading.

    Raises
    ------
    InputError
        The file cannot be read, a channel is missing, or a unit does not fit.
    """
    from duralab.formats import add_calculated, read_signals

    try:
        given = read_signals(path)
    except InputError as error:
        raise InputError(f"target.file: {error.message}", field="target.file") from error
    try:
        given = add_calculated(given, calculated)
    except InputError as error:
        raise InputError(f"target.calculated: {error.message}", field="target.calculated") from error
    target = map_channels(
        given,
        rig=rig,
        channels=channels,
        watched=watched,
        source=f"file {path}",
        remedy="say in target.channels which is which",
    )
    return EditedTarget(
        target, (_read_record(path, given=given, target=target, channels=channels, calculated=calculated),)
    )


def _read_record(
    path: Path,
    *,
    given: Signals,
    target: Signals,
    channels: Mapping[str, SourceChannel],
    calculated: Sequence[CalculatedChannel],
) -> StepRecord:
    """Return the record of reading the responses from the channels of a file."""
    from duralab.formats import LEFT_OUT

    stated = {name: channel.model_dump(mode="json", exclude_none=True) for name, channel in channels.items()}
    made = [one.model_dump(mode="json", exclude_none=True, exclude_defaults=True) for one in calculated]
    settings = {"file": path.name, **({"channels": stated} if stated else {}), **({"calculated": made} if made else {})}
    return StepRecord(
        name=READ_FILE,
        settings=dump_yaml(settings, flow=True, width=10_000).strip(),
        samples_before=given.samples.shape[1],
        samples_after=target.samples.shape[1],
        sample_rate_before=given.sample_rate,
        sample_rate_after=target.sample_rate,
        channels=tuple(
            ChannelRecord(response.name, 0.0, source=_source_record(given, target, row, channels.get(response.name)))
            for row, response in enumerate(target.channels)
        ),
        left_out=given.attributes.get(LEFT_OUT, ""),
    )


def _source_record(given: Signals, target: Signals, row: int, asked: SourceChannel | None) -> SourceRecord:
    response = target.channels[row]
    wanted = asked or SourceChannel.model_validate(response.name)
    if wanted.source not in given.names:
        return SourceRecord(source="")
    place = given.names.index(wanted.source)
    unit = wanted.unit or given.channels[place].unit
    # Conversion of 0 and 1 in the file's unit gives the factor, independent of the offset between the units.
    probe = replace(given, samples=np.tile([0.0, 1.0], (len(given.channels), 1)))
    zero, one = _converted(probe, place, unit=unit, wanted=response.unit, response=response.name)
    before, after = given.samples[place], target.samples[row]
    return SourceRecord(
        source=wanted.source,
        source_unit=given.channels[place].unit,
        stated_unit=wanted.unit or "",
        factor=float(wanted.scale * (one - zero)),
        peak_before=float(np.abs(before).max()),
        rms_before=float(np.sqrt(np.mean(before**2))),
        peak_after=float(np.abs(after).max()),
        rms_after=float(np.sqrt(np.mean(after**2))),
    )


def map_channels(
    signals: Signals,
    *,
    rig: Rig,
    source: str,
    remedy: str,
    channels: Mapping[str, SourceChannel] | None = None,
    watched: Collection[str] = (),
) -> Signals:
    """Convert measured channels to the names, order, units and signs of a rig's responses."""
    known, given = [channel.name for channel in rig.responses], channels or {}
    _require_known(given, known=known, rig=rig)
    asked = {name: given.get(name) or SourceChannel.model_validate(name) for name in known}
    missing = [
        name
        for name, wanted in asked.items()
        if wanted.source not in signals.names and (name in given or name not in watched)
    ]
    if missing:
        from duralab.formats import LEFT_OUT

        said = _missing(missing, asked=asked, given=signals.names, source=source, remedy=remedy)
        left_out = signals.attributes.get(LEFT_OUT, "")
        raise InputError(f"{said} {left_out}".rstrip(), field="target.channels")
    rows = []
    for response in rig.responses:
        wanted = asked[response.name]
        if wanted.source not in signals.names:
            rows.append(np.zeros(signals.samples.shape[1]))
            continue
        row = signals.names.index(wanted.source)
        unit = wanted.unit or signals.channels[row].unit
        values = _converted(signals, row, unit=unit, wanted=response.unit, response=response.name)
        rows.append(wanted.scale * values)
    return Signals(rig.responses, signals.sample_rate, np.stack(rows), signals.attributes)


def _require_known(channels: Collection[str], *, known: list[str], rig: Rig) -> None:
    unknown = [name for name in channels if name not in known]
    if unknown:
        raise InputError(
            f"target.channels has unknown response {', '.join(unknown)}; rig {rig.name!r} has {', '.join(known)}.",
            field="target.channels",
        )


def _missing(
    names: list[str], *, asked: Mapping[str, SourceChannel], given: tuple[str, ...], source: str, remedy: str
) -> str:
    wanted = [asked[name].source for name in names]
    close = get_close_matches(wanted[0], given, n=1)
    guess = f"; did you mean {close[0]!r}?" if close else "."
    responses = f" for {', '.join(names)}" if names != wanted else ""
    return f"target: {source} lacks {', '.join(wanted)}{responses}; it has {', '.join(given)}, so {remedy}{guess}"


def _converted(signals: Signals, row: int, *, unit: str, wanted: str, response: str) -> np.ndarray:
    if unit == wanted:
        return signals.samples[row]
    from duralab.formats import convert_units

    one = replace(
        signals, channels=(replace(signals.channels[row], unit=unit),), samples=signals.samples[row : row + 1]
    )
    try:
        return convert_units(one, [wanted]).samples[0]
    except InputError as error:
        raise InputError(
            f"target.channels.{response}: {error.message.rstrip('.')}; the rig needs {wanted}, so name the unit that "
            "the values have, e.g. 'unit: kN'.",
            field=f"target.channels.{response}.unit",
        ) from error
