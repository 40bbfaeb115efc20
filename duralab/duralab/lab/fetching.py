"""Fetch a recording from the recorder to the user, or report where it is."""

from __future__ import annotations

import hashlib
import os
import shlex
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import Final, TypeVar

from duralab.errors import InputError, LabError, ended
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.client import LabClient
from duralab.lab.recordings_folder import RecordingsPlace
from duralab.output_files import OUTPUTS, replace_when_complete
from duralab.recording import parts_beside
from duralab_bus import Bus, BusError, FaultError, SpanKind, span
from duralab_proto.keys import MAIN_INSTANCE
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from duralab_recordings import part_path

PART_BYTES: Final = 2 * 1024 * 1024
"""Size of a piece: 93 MB took 0.4 s on loopback, and 0.5 to 0.7 s in pieces of twice the size."""
PARTS_AHEAD: Final = 2
"""Number of pieces requested while one is written and hashed."""

CLOSE_SECONDS: Final = 30.0
"""Longest wait for the recorder to close a recording after its campaign ended."""


class Part(StrEnum):
    """Files of a recording; the values are from the contract."""

    RECORDING = "recording"
    LIVE = "live"


def wait_until_closed(bus: Bus, id: str, *, seconds: float = CLOSE_SECONDS) -> recorder_pb2.RecordingInfo:
    """Wait until a recording's file is complete and return its description."""
    deadline = time.monotonic() + seconds
    while True:
        information = bus.query(bus.keys.recording(id), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo)
        if information.closed:
            return information
        if time.monotonic() > deadline:
            raise LabError(f"The recorder did not close the recording {id!r} within {seconds:g} s.")
        time.sleep(0.1)


def fetch(bus: Bus, id: str, *, part: Part, path: Path, number: int = 1, file_hash: str = "") -> None:
    """Write a file of a closed recording to `path`."""

    def ask(offset: int) -> recorder_pb2.RecordingPart:
        request = recorder_pb2.ReadRecordingRequest(offset=offset, length=PART_BYTES, part=part.value, number=number)
        return bus.query(bus.keys.recording_read(id), request, recorder_pb2.RecordingPart)

    digest, offset, total = hashlib.sha256(), 0, 0
    with replace_when_complete(path) as temporary, temporary.open("xb") as stream:
        for piece in _in_order(ask):
            total = piece.total
            if piece.offset != offset:
                break
            stream.write(piece.data)
            digest.update(piece.data)
            offset += len(piece.data)
        if offset != total:
            raise LabError(f"The recorder sent {offset} of {total} bytes of {id!r} and then not what follows them.")
        if file_hash and digest.hexdigest() != file_hash:
            raise LabError(
                f"The recording {id!r} came with the SHA-256 {digest.hexdigest()}; the recorder says {file_hash}."
            )


def _in_order(ask: Callable[[int], recorder_pb2.RecordingPart]) -> Iterator[recorder_pb2.RecordingPart]:
    """Request a file piece by piece, a few pieces ahead."""
    first = ask(0)
    yield first
    with ThreadPoolExecutor(PARTS_AHEAD, thread_name_prefix="duralab-fetch") as pool:
        offsets = iter(range(max(1, len(first.data)), first.total, PART_BYTES))
        asked: deque[Future[recorder_pb2.RecordingPart]] = deque()
        asked.extend(pool.submit(ask, offset) for offset in islice(offsets, PARTS_AHEAD))
        while asked:
            piece = asked.popleft().result()
            asked.extend(pool.submit(ask, offset) for offset in islice(offsets, 1))
            yield piece


def fetch_result(
    bus: Bus,
    specification: iterator_pb2.CampaignSpec,
    status: iterator_pb2.CampaignStatus,
    *,
    folder: Path,
    place: RecordingsPlace,
) -> CampaignResult:
    """Fetch the files of a finished campaign into a folder; a private lab's files are linked where that is possible."""
    information = wait_until_closed(bus, specification.id)
    if information.missing_blocks:
        raise LabError(
            f"The recording {specification.id!r} lacks {information.missing_blocks} signal blocks that the bus "
            "lost; it stays with the recorder, run the campaign again."
        )
    with span("fetch the recording", SpanKind.DISK):
        linked = _link_files(information, folder=folder, place=place)
        recording_path, live_path = linked or fetch_files(bus, information, folder=folder)
    return CampaignResult(
        specification=specification, status=status, recording_path=recording_path, live_path=live_path
    )


def _link_files(
    information: recorder_pb2.RecordingInfo, *, folder: Path, place: RecordingsPlace
) -> tuple[Path, Path] | None:
    """Link the files of a finished campaign of a private lab into a folder; None if that is not possible.

    The recorder does not write to them again, and its folder is deleted at the end of the lab.
    """
    recording_path, live_path = folder / "recording.mcap", folder / "live.rrd"
    first = place.file(information.recording)
    if first is None or not place.is_private:
        return None
    live = first.with_suffix(live_path.suffix)
    if not live.is_file():
        return None
    stale = [path for number, path in parts_beside(recording_path).items() if number > len(information.files)]
    numbers = range(1, len(information.files) + 1)
    links = [(part_path(first, number), part_path(recording_path, number)) for number in numbers]
    try:
        for source, path in (*links, (live, live_path)):
            with replace_when_complete(path) as temporary:
                os.link(source, temporary)
    except InputError:  # another disk, or one without links: the files are fetched over the bus
        return None
    for path in stale:
        path.unlink()
    return recording_path, live_path


def fetch_files(bus: Bus, information: recorder_pb2.RecordingInfo, *, folder: Path) -> tuple[Path, Path]:
    """Fetch the files of a closed recording into a folder."""
    id, recording_path, live_path = information.recording, folder / "recording.mcap", folder / "live.rrd"
    # An older recorder reports only the first file, and has no other.
    files = list(information.files) or [recorder_pb2.RecordingFile(file_hash=information.file_hash)]
    stale = [place for number, place in parts_beside(recording_path).items() if number > len(files)]
    for number, file in enumerate(files, start=1):
        path = part_path(recording_path, number)
        fetch(bus, id, part=Part.RECORDING, path=path, number=number, file_hash=file.file_hash)
    # Files of an earlier, longer recording would be read as parts of this one.
    for place in stale:
        place.unlink()
    try:
        fetch(bus, id, part=Part.LIVE, path=live_path)
    except FaultError as fault:
        # The recorder may be set to write no live file; it can be made later from the recording.
        if fault.code != query_pb2.FAULT_CODE_NOT_FOUND:
            raise
        # The live file of an earlier recording would be shown as this one's.
        live_path.unlink(missing_ok=True)
    return recording_path, live_path


RESCUE_SECONDS: Final = 10.0
"""Longest wait until a stopped campaign's recording is closed; then it stays at the recorder."""

_PLAYED: Final = "What was played until then"

ErrorT = TypeVar("ErrorT", bound=BaseException)


@dataclass(frozen=True)
class Recovery:
    """Recovery of the recording of a campaign that failed; `folder` is the folder of its outputs."""

    ask: LabClient
    id: str
    folder: Path
    place: RecordingsPlace

    def annotate(self, error: ErrorT, *, played: bool, fetch: bool = True) -> ErrorT:
        """Fetch the recording into `folder` unless `fetch` is False; return the error with the recording's path."""
        sentence = self._brought(played=played) if fetch else self._where_it_lies(played=played)
        if sentence and isinstance(error, LabError):
            return type(error)(f"{ended(error.message)} {sentence}", field=error.field, service=error.service)
        if sentence:
            error.add_note(sentence)
        return error

    def _brought(self, *, played: bool) -> str:
        try:
            if self._will_be_closed() and self._may_be_fetched():
                information = wait_until_closed(self.ask.bus, self.id, seconds=RESCUE_SECONDS)
                # Also with missing blocks: the recording shows what happened, and proves no result.
                path, _ = fetch_files(self.ask.bus, information, folder=self.folder)
                self.place.fetched.add(self.id)
                further = (
                    f" The lab keeps it, too: {self._resume} continues it." if played and self.place.goes_on else ""
                )
                return self.place.say(self.id, f"{_PLAYED} is in {path}; {_reader(played=played)}{further}")
        except KeyboardInterrupt as again:
            self.annotate(again, played=played, fetch=False)
            raise
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_NOT_FOUND and self.place.file(self.id) is None:
                return ""
        except (LabError, BusError):
            pass  # The sentence below names the present place instead; the campaign's error is more important.
        return self._where_it_lies(played=played)

    def _where_it_lies(self, *, played: bool) -> str:
        if (path := self.place.file(self.id)) is not None:
            further = f" `duralab resume {shlex.quote(str(path))}` continues it." if played else ""
            return self.place.say(self.id, f"{_PLAYED} is in {path}; {_reader(played=played)}{further}")
        if self.place.goes_on:
            further = f"; {self._resume} continues it" if played else ""
            return f"{_PLAYED} stays with the recorder of the lab as {self.id!r}{further}."
        return ""

    @property
    def _resume(self) -> str:
        return f"`duralab resume {self.id}`"

    def _will_be_closed(self) -> bool:
        """Return whether the iterator, which closes the recording, and the recorder are on the bus."""
        needed, failure = {"iterator", "recorder"}, self.ask.failure()
        if failure is not None and failure.service in needed:
            return False
        return {(service, MAIN_INSTANCE) for service in needed} <= self.ask.bus.live()

    def _may_be_fetched(self) -> bool:
        """Return whether the folder outlives the lab and contains no outputs that would be overwritten."""
        return self.place.outlives(self.folder) and not any((self.folder / name).exists() for name in OUTPUTS)


def _reader(*, played: bool) -> str:
    return "`duralab report` shows it." if played else "`duralab.open` reads it."
