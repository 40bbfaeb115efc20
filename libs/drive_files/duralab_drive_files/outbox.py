"""Outbox of an exchange folder: drive files for a controller, complete or absent, and their settings beside them."""

from __future__ import annotations

import hashlib
import html
import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from duralab_drive_files.controller_map import ControllerMap
from duralab_drive_files.errors import DriveFileError
from duralab_drive_files.rates import resampled
from duralab_drive_files.rpc3_writing import Rpc3Settings, write_rpc3
from duralab_drive_files.time_history import TimeHistory
from duralab_settings import lock_file

# Largest share of the RMS of a drive that the sample rate of its file may remove.
_LARGEST_LOSS: Final = 0.01
# Share of its limit below which the RMS of a drive is that of rounding.
_SILENT: Final = 1e-5


@dataclass(frozen=True)
class OrderedChannel:
    """Channel of a drive file with the controller's settings, in the controller's unit.

    `name`: Descriptor in the file. `full_scale`: Larger limit. `peak`: Largest magnitude in the file. `slew`: Largest
    rate in the file, per second.
    """

    name: str
    unit: str
    full_scale: float
    minimum: float
    maximum: float
    peak: float
    slew: float


@dataclass(frozen=True)
class Order:
    """Drive file and its order, as in `<run>.json` beside it.

    Parameters
    ----------
    run : str
        Name of the run.
    drive_file : str
        Name of the drive file.
    sha256 : str
        SHA-256 of the drive file.
    sample_rate : float
        Sample rate of the drive file, in Hz.
    samples, lead_samples : int
        True length of the drive file, and of each of its leads, in samples.
    drive_has_offset : bool
        Whether the controller ramps to the first sample and from the last one.
    channels : tuple of OrderedChannel
        Channels in the order of the drives.
    response_file : str
        Name of the expected response file.
    wanted_channels : tuple of str
        Channels that the response file must hold.
    recorded_commands : dict of str to str
        Channel with the recorded command, by the channel of the drive file.
    written : str
        Time of writing, UTC.
    drive_sha256, seed : str, int
        Hash and seed of the requested drive: the same request is not written twice.
    ended, response_sha256 : str
        Reason of its end, and hash of the accepted response; empty while it waits.
    answered_run : str
        Run that got the response, which may be a later one that resumed the wait.
    """

    run: str
    drive_file: str
    sha256: str
    sample_rate: float
    samples: int
    lead_samples: int
    drive_has_offset: bool
    channels: tuple[OrderedChannel, ...]
    response_file: str
    wanted_channels: tuple[str, ...]
    recorded_commands: dict[str, str]
    written: str
    drive_sha256: str
    seed: int = 0
    ended: str = ""
    response_sha256: str = ""
    answered_run: str = ""

    @property
    def names(self) -> set[str]:
        """Names of the runs that requested this drive."""
        return {self.run, self.answered_run} - {""}

    @property
    def ways_out(self) -> str:
        """Remedies for an order that waits, as the end of a sentence."""
        return (
            f"play {self.drive_file} and save {self.response_file} into the inbox, refuse it with "
            f"{self.run}.refuse.txt there, or resume what asked for it."
        )


class Outbox:
    """Outbox of one exchange folder; one process at a time writes into it.

    Parameters
    ----------
    controller_map : ControllerMap
        Channels, rates and the folder, which is made if it is missing.

    Raises
    ------
    DriveFileError
        If the folder cannot be written, or another gateway uses it; one sentence.
    """

    def __init__(self, controller_map: ControllerMap) -> None:
        self.map = controller_map
        folder = controller_map.exchange
        self.folder, self.inbox, self.done = folder / "outbox", folder / "inbox", folder / "outbox" / "done"
        with written_into(folder):
            for each in (self.done, self.inbox):
                each.mkdir(parents=True, exist_ok=True)
            lock = folder / ".lock"
            lock.touch()
            try:
                self._lock = lock_file(lock)
            except OSError as error:
                raise DriveFileError(
                    "another gateway uses this exchange folder; end it, or give this one its own folder.",
                    path=folder,
                ) from error

    def close(self) -> None:
        """Release the folder for other processes."""
        os.close(self._lock)

    def waiting(self) -> Order | None:
        """Return the order that waits for its response, also one of an earlier process.

        Returns
        -------
        Order or None
            Waiting order; there is at most one.

        Raises
        ------
        DriveFileError
            If its file is not an order.
        """
        paths = sorted(self.folder.glob("*.json"))
        return read_order(paths[0]) if paths else None

    def ended(self) -> list[Order]:
        """Return the orders that ended.

        Returns
        -------
        list of Order
            Orders by the names of their runs.

        Raises
        ------
        DriveFileError
            If a file is not an order.
        """
        return [read_order(path) for path in sorted(self.done.glob("*.json"))]

    def put(self, run: str, drive: np.ndarray, *, seed: int = 0) -> Order:
        """Write a drive file, the operator's sheet, and last the order, whose presence allows to play the drive.

        Parameters
        ----------
        run : str
            Name of the run; no file may have that name.
        drive : ndarray, shape (drives, samples)
            Drive in the units and at the sample rate of the lab.
        seed : int
            Seed of the request.

        Returns
        -------
        Order
            Order as written to disk.

        Raises
        ------
        DriveFileError
            If a drive is beyond its channel's range, another order waits, the run ended before, or the folder cannot be
            written; no order exists then.
        """
        if (other := self.waiting()) is not None:
            raise DriveFileError(f"run {other.run!r} waits for its response; {other.ways_out}")
        if (self.done / f"{run}.json").exists():
            raise DriveFileError(f"run {run!r} ended before; give every run its own name.")
        order, history = _ordered(self.map, run, drive, seed)
        path = self.folder / order.drive_file
        partial = path.with_name(f"{path.name}.part")
        with written_into(self.folder):
            try:
                scales = [channel.full_scale for channel in order.channels]
                write_rpc3(history, partial, Rpc3Settings(data_type=self.map.numbers), full_scales=scales)
                order = replace(order, sha256=file_hash(partial))
                keep(partial, path)
                write_text(self.folder / f"{run}.html", operator_sheet(self.map, order))
                write_text(self.folder / f"{run}.json", json.dumps(asdict(order), indent=2))
            except BaseException:
                self._remove(run)
                raise
        return order

    def end(self, order: Order, how: str, *, response_sha256: str = "", answered_run: str = "") -> None:
        """Move an order and its files to `outbox/done`, so that no order waits any more.

        Parameters
        ----------
        order : Order
            Order that waited.
        how : str
            Reason of its end.
        response_sha256 : str
            SHA-256 of the accepted response, if any.
        answered_run : str
            Run that got the response.

        Raises
        ------
        DriveFileError
            If the folder cannot be written.
        """
        run, response = order.run, order.response_file
        ended = replace(order, ended=how, response_sha256=response_sha256, answered_run=answered_run)
        with written_into(self.folder):
            write_text(self.done / f"{run}.json", json.dumps(asdict(ended), indent=2))
            # The order first: a controller must not read a drive of a run that has ended.
            (self.folder / f"{run}.json").unlink(missing_ok=True)
            for folder, name in (
                (self.folder, order.drive_file),
                (self.folder, f"{run}.html"),
                (self.inbox, response),
                (self.inbox, f"{run}.refuse.txt"),
                (self.inbox, f"{response}.refused.txt"),
            ):
                with suppress(FileNotFoundError):
                    (folder / name).replace(self.done / name)

    def _remove(self, run: str) -> None:
        """Remove all files of an order that could not be written."""
        for suffix in (".json", ".json.part", ".html", ".html.part", ".drv", ".drv.part"):
            with suppress(OSError):
                (self.folder / f"{run}{suffix}").unlink(missing_ok=True)


def read_order(path: Path) -> Order:
    """Read the order file beside a drive file.

    Parameters
    ----------
    path : Path
        Path of `<run>.json`.

    Returns
    -------
    Order
        Order as written.

    Raises
    ------
    DriveFileError
        If it is not an order.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        channels = tuple(OrderedChannel(**channel) for channel in values.pop("channels"))
        return Order(channels=channels, wanted_channels=tuple(values.pop("wanted_channels")), **values)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise DriveFileError(
            f"it is no order of a drive ({type(error).__name__}); find out what changed it, and move it away.",
            path=path,
        ) from error


def drive_hash(drive: np.ndarray) -> str:
    """Return a hash that identifies a drive.

    Parameters
    ----------
    drive : ndarray, shape (drives, samples)
        Drive as requested by the lab.

    Returns
    -------
    str
        SHA-256, hexadecimal.
    """
    return hashlib.sha256(np.ascontiguousarray(drive, dtype="<f8").tobytes()).hexdigest()


def lead_samples(controller_map: ControllerMap) -> int:
    """Return the length of each lead in the drive file, at the sample rate of the lab."""
    if controller_map.drive_has_offset:
        return 0
    return int(np.ceil(controller_map.lead_seconds * controller_map.sample_rate))


def with_leads(controller_map: ControllerMap, drive: np.ndarray) -> np.ndarray:
    """Return a drive with its leads from rest and back, raised cosines, unless the controller makes them."""
    count = lead_samples(controller_map)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / max(count, 1))
    return np.hstack([drive[:, :1] * rise, drive, drive[:, -1:] * rise[::-1]])


def drive_faults(controller_map: ControllerMap, drive: np.ndarray) -> Iterator[str]:
    """Yield the errors of a drive in the file for the controller: steep leads from rest and back, and lost motion.

    Parameters
    ----------
    controller_map : ControllerMap
        Both sample rates, length of each lead, and the slew limits; a controller makes its own leads with
        `drive_has_offset`.
    drive : ndarray, shape (drives, samples)
        Drive in the units of the lab.

    Yields
    ------
    str
        Clause for each drive that exceeds its slew limit in a lead, or moves faster than the rate of the file holds,
        without a full stop.
    """
    shares = _lost_shares(controller_map, drive)
    for channel, row, lost in zip(controller_map.drives, drive, shares, strict=True):
        # Largest rate of a raised cosine.
        fastest = 0.5 * np.pi * max(abs(row[0]), abs(row[-1])) / controller_map.lead_seconds
        if not controller_map.drive_has_offset and 0.0 < channel.slew_limit < fastest:
            yield (
                f"{channel.name} moves at {fastest:.4g} {channel.unit}/s in its lead of "
                f"{controller_map.lead_seconds:g} s, and {channel.slew_limit:.4g} {channel.unit}/s are allowed: "
                "raise lead in the map, or begin and end nearer to 0"
            )
        if lost > _LARGEST_LOSS:
            yield (
                f"{channel.name} loses {100 * lost:.1f} % of its RMS at controller_rate "
                f"{controller_map.controller_rate:g} Hz: "
                "raise it to 2.3 times the highest frequency of the drive or more"
            )


def _lost_shares(controller_map: ControllerMap, drive: np.ndarray) -> np.ndarray:
    """Return the RMS of each drive that the sample rate of the file removes, over the RMS about its mean."""
    rate, there = controller_map.sample_rate, controller_map.controller_rate
    if there >= rate:
        return np.zeros(len(drive))
    back = resampled(resampled(drive, rate, there), there, rate)
    samples = min(back.shape[1], drive.shape[1])
    silent = [_SILENT * max(-channel.minimum, channel.maximum) for channel in controller_map.drives]
    lost = np.sqrt(np.mean((back[:, :samples] - drive[:, :samples]) ** 2, axis=1))
    return lost / np.maximum(silent, drive.std(axis=1))


def operator_sheet(controller_map: ControllerMap, order: Order) -> str:
    """Return the page for the person at the controller."""
    rows = "".join(
        f"<tr><td>{html.escape(each.name)}</td><td>{html.escape(each.unit)}</td><td>{each.minimum:.6g}</td>"
        f"<td>{each.maximum:.6g}</td><td>{each.full_scale:.6g}</td><td>{each.peak:.6g}</td><td>{each.slew:.4g}</td></tr>"
        for each in order.channels
    )
    seconds, lead = order.samples / order.sample_rate, order.lead_samples / order.sample_rate
    leads = (
        "<b>The drive has an offset</b>: let the controller ramp to the first sample and from the last one."
        if order.drive_has_offset
        else f"It begins and ends at rest, with ways of {lead:g} s in and out."
    )
    wanted = ", ".join(html.escape(name) for name in order.wanted_channels)
    title, run = html.escape(f"{controller_map.rig}: {order.run}"), html.escape(order.run)
    headings = ("Channel", "unit", "minimum", "maximum", "full scale", "peak", "largest rate, per s")
    return "\n".join(
        (
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>',
            "<style>body {font: 16px sans-serif; max-width: 55em; margin: 2em}",
            "td, th {padding: .3em .8em; text-align: left; border-bottom: 1px solid #ccc}</style>",
            f"<h1>{title}</h1>",
            f"<p>Play <b>{html.escape(order.drive_file)}</b> once, at a span of 100 %: {seconds:.1f} s at "
            f"{order.sample_rate:g} Hz. {leads}</p>",
            f"<table><tr>{''.join(f'<th>{each}</th>' for each in headings)}</tr>{rows}</table>",
            f"<p>Record from the start of the file to its end: {wanted}.</p>",
            f"<p>Save as <b>inbox/{html.escape(order.response_file)}</b>. Where it must not be played, write the "
            f"reason into <b>inbox/{run}.refuse.txt</b>.</p>",
            f"<p>SHA-256 of the drive file: <code>{order.sha256}</code>, written {order.written}.</p></html>",
        )
    )


def _ordered(controller_map: ControllerMap, run: str, drive: np.ndarray, seed: int) -> tuple[Order, TimeHistory]:
    """Return the order of a drive, without the hash of its file, and the content of the file."""
    rate, drives = controller_map.controller_rate, controller_map.drives
    there = controller_map.drives_to_controller(with_leads(controller_map, drive))
    samples = resampled(there, controller_map.sample_rate, rate)
    channels = []
    for mapped, row in zip(drives, samples, strict=True):
        ends = sorted(mapped.scale * end + mapped.offset for end in (mapped.minimum, mapped.maximum))
        channels.append(
            OrderedChannel(
                name=mapped.controller_channel,
                unit=mapped.controller_unit,
                full_scale=mapped.full_scale,
                minimum=ends[0],
                maximum=ends[1],
                peak=float(np.abs(row).max()),
                slew=float(np.abs(np.diff(row)).max(initial=0.0)) * rate,
            )
        )
    recorded = {each.controller_channel: each.recorded_command for each in drives if each.recorded_command}
    order = Order(
        run=run,
        drive_file=f"{run}.drv",
        sha256="",
        sample_rate=rate,
        samples=samples.shape[1],
        lead_samples=round(lead_samples(controller_map) * rate / controller_map.sample_rate),
        drive_has_offset=controller_map.drive_has_offset,
        channels=tuple(channels),
        response_file=f"{run}.rsp",
        wanted_channels=(*recorded.values(), *(each.controller_channel for each in controller_map.responses)),
        recorded_commands=recorded,
        written=utc(time.time()),
        drive_sha256=drive_hash(drive),
        seed=seed,
    )
    names = tuple(channel.name for channel in channels)
    return order, TimeHistory(names, tuple(channel.unit for channel in channels), rate, samples)


def keep(partial: Path, path: Path) -> None:
    """Flush a written file to disk, and give it its name."""
    with partial.open("rb+") as stream:
        os.fsync(stream.fileno())
    partial.replace(path)


def write_text(path: Path, text: str) -> None:
    """Write a text completely or not at all."""
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        keep(partial, path)
    except BaseException:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def utc(seconds: float) -> str:
    """Return a time as ISO 8601."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


@contextmanager
def written_into(folder: Path) -> Iterator[None]:
    """Convert an error of the operating system for a folder to one sentence."""
    try:
        yield
    except OSError as error:
        raise DriveFileError(
            f"it cannot be written ({error.strerror or error}); free the disk, or correct its rights.", path=folder
        ) from error
