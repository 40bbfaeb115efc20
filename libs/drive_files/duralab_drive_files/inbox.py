"""Inbox of an exchange folder: response files of a controller, and the check that they belong to their drive."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from duralab_drive_files.alignment import Alignment, align, shifted
from duralab_drive_files.controller_map import ControllerMap
from duralab_drive_files.errors import DriveFileError
from duralab_drive_files.outbox import Order, Outbox, file_hash, lead_samples, read_order, utc, write_text, written_into
from duralab_drive_files.rates import resampled
from duralab_drive_files.rpc3_reading import read_rpc3

_STABLE_SECONDS: Final = 0.5
"""Time in s without a change of size and time stamp after which a file is complete."""

_FUTURE_SECONDS: Final = 60.0
"""Largest difference in s of the clocks of two machines."""

_LOWEST_RATE: Final = 0.5
_HIGHEST_RATE: Final = 64.0
"""Highest sample rate of a response file, over that of the lab."""

_EARLIER_RUNS: Final = 5
"""Number of newest ended runs with whose drives a response is compared."""

_LEAST_DIFFERENCE: Final = 5e-4
"""Least RMS difference of two drives, over their RMS values, at which a record shows which of them was played."""

_STILL: Final = 0.01
"""Largest movement of the recorded command of a constant drive, as a share of its limit."""


@dataclass(frozen=True, eq=False)
class AcceptedResponse:
    """Response that belongs to its drive.

    Parameters
    ----------
    response : ndarray, shape (responses, samples)
        Response in the units of the lab, at the drive's samples.
    alignment : Alignment or None
        Alignment of the recorded commands; the lag counts from the drive's position in the file. None without commands.
    drives : tuple of str
        Drives with recorded commands, in the order of `alignment`.
    sha256 : str
        SHA-256 of the file.
    remarks : tuple of str
        Omitted checks and missing content, one sentence each.
    """

    response: np.ndarray
    alignment: Alignment | None
    drives: tuple[str, ...]
    sha256: str
    remarks: tuple[str, ...]


class Inbox:
    """Inbox beside an outbox.

    Parameters
    ----------
    outbox : Outbox
        Outbox of the same exchange folder.
    stable_seconds : float
        Time in s without a change after which a file is complete.
    """

    def __init__(self, outbox: Outbox, *, stable_seconds: float = _STABLE_SECONDS) -> None:
        self._outbox = outbox
        self._stable_seconds = stable_seconds
        self._seen: tuple[Path | None, tuple[int, int]] = (None, (0, 0))
        self._since = 0.0
        self._refused: tuple[Path | None, tuple[int, int]] = (None, (0, 0))
        self.refusal = ""
        """Reason why the present response file was not accepted, one sentence; empty if none was refused."""

    def refusal_by_person(self, order: Order) -> str:
        """Return a person's reason to refuse a run, from `<run>.refuse.txt`.

        Parameters
        ----------
        order : Order
            Order that waits.

        Returns
        -------
        str
            Reason; empty if there is no such file.
        """
        path = self._outbox.inbox / f"{order.run}.refuse.txt"
        with suppress(OSError):
            return " ".join(path.read_text(encoding="utf-8", errors="replace").split())[:300] or "no reason given"
        return ""

    def take(self, order: Order, drive: np.ndarray) -> AcceptedResponse | None:
        """Return the response of an order after its file is complete and belongs to the drive.

        A file that does not belong is left, with the reason beside it; it is judged again when it changes.

        Parameters
        ----------
        order : Order
            Order that waits.
        drive : ndarray, shape (drives, samples)
            Drive as requested by the lab.

        Returns
        -------
        AcceptedResponse or None
            Response; None as long as there is no acceptable file.

        Raises
        ------
        DriveFileError
            If the inbox cannot be read or written.
        """
        path = self._outbox.inbox / order.response_file
        reason = path.with_name(f"{path.name}.refused.txt")
        try:
            found = path.stat()
        except FileNotFoundError:
            self.refusal = ""
            return None
        seen, now = (path, (found.st_size, found.st_mtime_ns)), time.monotonic()
        if self._seen != seen:
            self._seen, self._since = seen, now
        if now - self._since < self._stable_seconds or self._refused == seen:
            return None
        try:
            self._check_time(order, found.st_mtime)
            accepted = judged(self._outbox.map, order, drive, path, earlier=self._earlier(order))
            self._check_new(accepted)
        except DriveFileError as error:
            self._refused, self.refusal = seen, error.sentence
            with written_into(self._outbox.inbox):
                write_text(reason, f"{error.sentence}\n")
            return None
        self.refusal = ""
        with suppress(OSError):
            reason.unlink(missing_ok=True)
        return accepted

    def _check_time(self, order: Order, changed: float) -> None:
        now = time.time()
        if changed > now + _FUTURE_SECONDS:
            raise DriveFileError(
                f"its time stamp is {utc(changed)}, {changed - now:.0f} s in the future; set the controller's clock "
                "and save it again."
            )
        # Both stamps are of one file system.
        with suppress(FileNotFoundError):
            drive = (self._outbox.folder / order.drive_file).stat().st_mtime
            if changed < drive:
                raise DriveFileError(
                    f"it is of {utc(changed)} and older than its drive, {utc(drive)}; save the response of this run."
                )

    def _earlier(self, order: Order) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the newest ended runs with a drive of this length, and their drives."""
        controller, lead = self._outbox.map, lead_samples(self._outbox.map)
        drives = sorted(self._outbox.done.glob("*.drv"), key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for path in drives[:_EARLIER_RUNS]:
            with suppress(DriveFileError):
                before, history = read_order(path.with_suffix(".json")), read_rpc3(path)
                if before.samples != order.samples:
                    continue
                drive = resampled(
                    controller.drives_from_controller(history), history.sample_rate, controller.sample_rate
                )
                begin = 0 if order.drive_has_offset else lead
                yield before.run, drive[:, begin:]

    def _check_new(self, accepted: AcceptedResponse) -> None:
        for before in self._outbox.ended():
            if before.response_sha256 == accepted.sha256:
                raise DriveFileError(f"it is the response of run {before.run!r}; save that of this run.")


def judged(
    controller_map: ControllerMap,
    order: Order,
    drive: np.ndarray,
    path: Path,
    *,
    earlier: Iterable[tuple[str, np.ndarray]] = (),
) -> AcceptedResponse:
    """Read a response file, and judge whether it belongs to a drive.

    Parameters
    ----------
    controller_map : ControllerMap
        Channels and rates.
    order : Order
        Order of the drive.
    drive : ndarray, shape (drives, samples)
        Drive as requested by the lab.
    path : Path
        Path of an RPC III file.
    earlier : iterable of (str, ndarray of shape (drives, samples))
        Ended runs and their drives, from the first sample on. The record of one of them is refused, also if both drives
        are nearly the same, as in neighbouring iterations.

    Returns
    -------
    AcceptedResponse
        Response at the drive's samples.

    Raises
    ------
    DriveFileError
        If it is incomplete, lacks channels, is too short, or its recorded commands are not the drive; one sentence.
    """
    history = read_rpc3(path)
    rate, count = controller_map.sample_rate, drive.shape[1]
    remarks: list[str] = []
    if not _LOWEST_RATE <= history.sample_rate / rate <= _HIGHEST_RATE:
        raise DriveFileError(
            f"its sample rate is {history.sample_rate:g} Hz; {_LOWEST_RATE * rate:g} to {_HIGHEST_RATE * rate:g} Hz "
            f"can be resampled to {rate:g} Hz: record at such a rate."
        )
    if history.sample_rate < rate:
        remarks.append(
            f"The response was recorded at {history.sample_rate:g} Hz: it holds nothing above "
            f"{0.45 * history.sample_rate:g} Hz."
        )
    measured = controller_map.responses_from_controller(history)
    commands = controller_map.commands_from_controller(history)
    if missing := [name for drive_name, name in controller_map.recorded_commands.items() if drive_name not in commands]:
        raise DriveFileError(f"it lacks the recorded commands {', '.join(missing)}; record those of the map.")
    lead = 0 if order.drive_has_offset else lead_samples(controller_map)
    seconds, needed = history.samples.shape[1] / history.sample_rate, (lead + count) / rate
    if seconds < needed - 1.0 / min(rate, history.sample_rate):
        raise DriveFileError(
            f"it is {seconds:.3f} s long, and way in and drive take {needed:.3f} s; record the whole file, and save "
            "its last frame."
        )
    response = resampled(measured, history.sample_rate, rate)
    names = [each.name for each in controller_map.drives]
    rows = [row for row, name in enumerate(names) if name in commands]
    if unchecked := [name for name in names if name not in commands]:
        remarks.append(
            f"No command was recorded of {', '.join(unchecked)}: it was not checked that the response is of this "
            "drive; record it, and name it as recorded_command in the map."
        )
    found: Alignment | None = None
    if rows:
        recorded = resampled(np.stack([commands[names[row]] for row in rows]), history.sample_rate, rate)
        limits = [max(-controller_map.drives[row].minimum, controller_map.drives[row].maximum) for row in rows]
        checked = [names[row] for row in rows]
        if np.ptp(drive[rows], axis=1).any():
            reaching = _reaching(recorded, count)
            found = align(reaching, drive[rows], limits=limits, names=checked, rate=rate)
            played = shifted(reaching, found.lag, count)
            _require_own(played, drive[rows], found, [(run, other[rows]) for run, other in earlier])
        else:
            _require_still(recorded[:, lead : lead + count], drive[rows], limits, checked)
            remarks.append("No drive moves: the response is taken from where the drive lies in the file.")
    placed = shifted(_reaching(response, lead + count), found.lag if found else lead, count)
    return AcceptedResponse(
        response=placed,
        alignment=replace(found, lag=found.lag - lead) if found else None,
        drives=tuple(names[row] for row in rows) if found else (),
        sha256=file_hash(path),
        remarks=tuple(remarks),
    )


def _require_own(
    recorded: np.ndarray, drive: np.ndarray, found: Alignment, earlier: Iterable[tuple[str, np.ndarray]]
) -> None:
    """Refuse the record of an earlier run whose drive correlates with this one but differs."""
    size = drive.std(axis=1, keepdims=True)
    moving = size[:, 0] > 0.0
    played = (recorded - np.array([found.offset]).T) / np.array([found.gain]).T

    def difference(other: np.ndarray) -> float:
        """Return the RMS difference to the played drive, over the RMS value of each drive."""
        # After resampling, a drive may end a part of a sample early.
        count = min(other.shape[1], drive.shape[1] - 1)
        return float(np.sqrt(np.mean(((played[:, :count] - other[:, :count])[moving] / size[moving]) ** 2)))

    left = difference(drive)
    for run, other in earlier if left > _LEAST_DIFFERENCE else ():
        if difference(other) < 0.5 * left:
            raise DriveFileError(
                f"its recorded commands are the drive of run {run!r}, and not of this one; save the response of this "
                "run."
            )


def _require_still(recorded: np.ndarray, drive: np.ndarray, limits: list[float], names: list[str]) -> None:
    """Refuse commands that move although no drive does."""
    for row, name in enumerate(names):
        if np.abs(recorded[row] - drive[row, 0]).max() > _STILL * limits[row]:
            raise DriveFileError(f"the command of {name} moves, and its drive does not; give the response of this run.")


def _reaching(rows: np.ndarray, samples: int) -> np.ndarray:
    """Return rows of at least `samples`: after resampling, a file may end a part of a sample before its drive."""
    return np.pad(rows, ((0, 0), (0, max(samples - rows.shape[1], 0))), mode="edge")
