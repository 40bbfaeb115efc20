"""Manual exchange of files with a rig's controller: export a drive, import its response, as the file gateway does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from duralab.data import Channel, Signals
from duralab.errors import InputError
from duralab.formats.errors import FormatError, as_input_error
from duralab.formats.units import convert_units
from duralab_proto.channels import overdue_calibrations
from duralab_proto.keys import KeyNameError, check_run

if TYPE_CHECKING:
    from duralab_drive_files import Alignment, ControllerMap, MappedChannel, Order
    from duralab_proto.v1 import rig_pb2


@dataclass(frozen=True)
class ExportedDrive:
    """Drive file that waits for its response.

    Parameters
    ----------
    path, page : Path
        Paths of the drive file, and of the order page beside it.
    order : Order
        Contents of the JSON file beside it.
    rig : str
        Name of the rig.
    limit_shares : tuple of float
        Peak over limit of each drive, in the order of the map.
    notes : tuple of str
        Sentences about resampling and overdue calibrations.
    """

    path: Path
    page: Path
    order: Order
    rig: str
    limit_shares: tuple[float, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ImportedResponse:
    """Response to a drive file, accepted and aligned.

    Parameters
    ----------
    signals : Signals
        Measured responses, then calculated ones, from the drive's first sample to its last, in the units of the lab.
    run : str
        Name of the run.
    alignment : Alignment or None
        Lag in samples of the lab, gain and offset of each recorded command; None if no command is recorded.
    notes : tuple of str
        Sentences about checks that could not be made, and overdue calibrations.
    """

    signals: Signals
    run: str
    alignment: Alignment | None
    notes: tuple[str, ...]


@as_input_error()
def export_drive(drive: Signals, controller_map: Path, *, run: str) -> ExportedDrive:
    """Write a drive for a rig's controller into the outbox of its map, with the order page.

    Parameters
    ----------
    drive : Signals
        Channels with the drives' names in the lab or at the controller; other channels are ignored.
    controller_map : Path
        YAML file of the map.
    run : str
        Name of the run and of its files, new in this exchange folder.

    Returns
    -------
    ExportedDrive
        Exported drive; nothing moved, because a person or a controller plays the file.

    Raises
    ------
    InputError
        The map, the drive or the folder cannot be used, or another run waits there; nothing was written.
    """
    from duralab_drive_files import Inbox, Outbox, read_controller_map

    try:
        check_run(run)
    except KeyNameError as error:
        raise InputError(str(error), field="run") from error
    mapped = read_controller_map(controller_map)
    samples, notes = _at_the_rate(mapped, drive, _drives_of(mapped, drive))
    _require_within(mapped, samples)
    with closing(Outbox(mapped)) as outbox:
        waiting = outbox.waiting()
        if waiting is not None and (reason := Inbox(outbox).refusal_by_person(waiting)):
            outbox.end(waiting, f"refused: {reason}")
            notes.append(f"Run {waiting.run!r} was refused at the controller: {reason.rstrip('.')}.")
        order = outbox.put(run, samples)
    limits = [max(-channel.minimum, channel.maximum) for channel in mapped.drives]
    folder = mapped.exchange / "outbox"
    return ExportedDrive(
        path=folder / order.drive_file,
        page=folder / f"{run}.html",
        order=order,
        rig=mapped.rig,
        limit_shares=tuple((np.abs(samples).max(axis=1) / limits).tolist()),
        notes=(*notes, *overdue_calibrations(_described(mapped).responses, today=date.today())),
    )


@as_input_error()
def import_response(path: Path, controller_map: Path, *, run: str | None = None) -> ImportedResponse:
    """Read a controller's response to a drive file of the outbox; check, align and convert it to the units of the lab.

    Parameters
    ----------
    path : Path
        Response file, RPC III.
    controller_map : Path
        YAML file of the map with which the drive was exported.
    run : str, optional
        Name of the run; the response file's name if not given.

    Returns
    -------
    ImportedResponse
        Response; the run has ended, and its files are in `outbox/done`.

    Raises
    ------
    InputError
        The map cannot be used, there is no such run, or the file is not the response to its drive.
    """
    from duralab_drive_files import Outbox, judged, read_controller_map

    mapped = read_controller_map(controller_map)
    run = run or path.stem
    with closing(Outbox(mapped)) as outbox:
        order, drive = _asked(mapped, run)
        found = judged(mapped, order, drive, path)
        for before in outbox.ended():
            if before.run != run and before.response_sha256 == found.sha256:
                raise FormatError(path, f"it is the response of run {before.run!r}; give that of run {run!r}.")
        if (waiting := outbox.waiting()) is not None and waiting.run == run:
            outbox.end(order, "imported", response_sha256=found.sha256)
    description = _described(mapped)
    rows = _with_calculated(mapped, description, found.response)
    channels = tuple(Channel.from_message(channel) for channel in description.responses)
    notes = (*found.remarks, *overdue_calibrations(description.responses, today=date.today()))
    return ImportedResponse(
        Signals(channels, mapped.sample_rate, rows, dict(_attributes(run, found.alignment))),
        run,
        found.alignment,
        notes,
    )


def _drives_of(mapped: ControllerMap, drive: Signals) -> np.ndarray:
    """Return the rows of a drive in the units of the lab; channels have the lab's or the controller's names."""
    from duralab_drive_files import TimeHistory

    names = [channel.name for channel in mapped.drives]
    if set(names) <= set(drive.names):
        rows = [drive.names.index(name) for name in names]
        own = Signals(tuple(drive.channels[row] for row in rows), drive.sample_rate, drive.samples[rows])
        return convert_units(own, {channel.name: channel.unit for channel in mapped.drives}).samples
    theirs = [channel.controller_channel for channel in mapped.drives]
    labels = tuple(channel.label or channel.name for channel in drive.channels)
    if set(theirs) <= set(labels):
        units = tuple(channel.unit for channel in drive.channels)
        return mapped.drives_from_controller(TimeHistory(labels, units, drive.sample_rate, drive.samples))
    raise InputError(
        f"The drive has the channels {', '.join(drive.names)}; the map needs {', '.join(names)}, or by their names at "
        f"the controller {', '.join(theirs)}.",
        field="drive",
    )


def _at_the_rate(mapped: ControllerMap, drive: Signals, samples: np.ndarray) -> tuple[np.ndarray, list[str]]:
    if drive.sample_rate == mapped.sample_rate:
        return samples, []
    from duralab_loads import resample

    try:
        resampled = resample(samples, sample_rate=drive.sample_rate, new_rate=mapped.sample_rate)
    except ValueError as error:
        raise InputError(f"The sample rate of the drive: {error}", field="drive") from error
    return resampled, [f"The drive was resampled from {drive.sample_rate:g} to {mapped.sample_rate:g} Hz."]


def _require_within(mapped: ControllerMap, samples: np.ndarray) -> None:
    from duralab_drive_files import drive_faults

    seconds = samples.shape[1] / mapped.sample_rate
    if seconds > mapped.longest_drive:
        raise InputError(
            f"The drive is {seconds:g} s long, and the map allows {mapped.longest_drive:g} s; cut it.", field="drive"
        )
    beyond = [sentence for each in zip(mapped.drives, samples, strict=True) for sentence in _beyond(mapped, *each)]
    beyond += drive_faults(mapped, samples)
    if beyond:
        raise InputError(f"The drive is beyond the limits of the map: {'; '.join(beyond)}.", field="drive")


def _beyond(mapped: ControllerMap, channel: MappedChannel, row: np.ndarray) -> Iterator[str]:
    # A decimal number in the file may exceed a limit of the same digits by the last bit.
    slack = 1e-9 * (channel.maximum - channel.minimum)
    lowest, highest = float(row.min()), float(row.max())
    if lowest < channel.minimum - slack or highest > channel.maximum + slack:
        yield (
            f"{channel.name} goes from {lowest:.4g} to {highest:.4g} {channel.unit}, and {channel.minimum:.4g} to "
            f"{channel.maximum:.4g} {channel.unit} are allowed"
        )
    fastest = float(np.abs(np.diff(row)).max(initial=0.0)) * mapped.sample_rate
    if 0.0 < channel.slew_limit < fastest * (1.0 - 1e-9):
        yield (
            f"{channel.name} moves at {fastest:.4g} {channel.unit}/s, and {channel.slew_limit:.4g} {channel.unit}/s "
            "are allowed"
        )


def _asked(mapped: ControllerMap, run: str) -> tuple[Order, np.ndarray]:
    """Return the order of a run, waiting or ended, and the drive in its file."""
    from duralab_drive_files import read_order, read_rpc3, sampled_at

    outbox = mapped.exchange / "outbox"
    for folder in (outbox, outbox / "done"):
        if (folder / f"{run}.json").is_file():
            break
    else:
        raise InputError(
            f"No drive of run {run!r} was written into {outbox}; name the run of this response with --run.", field="run"
        )
    order = read_order(folder / f"{run}.json")
    drive_file = folder / order.drive_file
    history = read_rpc3(drive_file)
    if _sha256(drive_file) != order.sha256:
        raise FormatError(
            drive_file, f"its SHA-256 is not the one in {run}.json, so it was changed; export the drive as another run."
        )
    rate, file_rate = mapped.sample_rate, history.sample_rate
    # The drive's last sample may be up to one step of the file after the file's last sample.
    instants = np.arange(math.ceil((history.samples.shape[1] - 1) * rate / file_rate - 1e-6) + 1) / rate
    rows = sampled_at(mapped.drives_from_controller(history), file_rate, instants, new_rate=rate)
    lead = round(order.lead_samples * rate / file_rate)
    return order, np.ascontiguousarray(rows[:, lead : rows.shape[1] - lead])


def _sha256(path: Path) -> str:
    import hashlib

    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _described(mapped: ControllerMap) -> rig_pb2.RigDescription:
    return mapped.channels.complete(mapped.description(), today=date.today())


def _with_calculated(mapped: ControllerMap, description: rig_pb2.RigDescription, response: np.ndarray) -> np.ndarray:
    from duralab_gateway import weighted_sum

    return np.vstack(
        [response, *(weighted_sum(row, response)[np.newaxis] for row in mapped.channels.rows(description))]
    )


def _attributes(run: str, alignment: Alignment | None) -> Iterator[tuple[str, str]]:
    yield "duralab.run", run
    if alignment is not None:
        yield "duralab.lag_samples", repr(alignment.lag)
        yield "duralab.command_gain", " ".join(map(repr, alignment.gain))
        yield "duralab.command_offset", " ".join(map(repr, alignment.offset))
