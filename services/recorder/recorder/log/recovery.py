"""Unfinished recordings, reopened from their files, also after a kill or a failure of a disk."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import structlog

from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import (
    DAMAGE,
    SUMMARY_METADATA,
    check_begin,
    is_finished,
    last_metadata,
    messages_on,
    newer_format,
    reason_of,
    scan,
)
from recorder.format import (
    DAMAGED_FOLDER,
    SCENARIO_METADATA,
    STEP_TOPIC,
    Content,
    Runs,
    Summary,
    files_after_a_gap,
    files_of,
    read_summary,
    recording_path,
)
from recorder.log.recording import DiskError, Recording, StepOrder, Stored, as_disk_error
from recorder.mcap_log import finish, sync_folder
from recorder.refused import RefusedError

KILLED: Final = "Its recorder was killed."
MEBIBYTE: Final = 1024 * 1024
LEAST_FREE_BYTES: Final = 256 * MEBIBYTE


@dataclass(frozen=True)
class FreeSpaceGuard:
    """Space that must be free on the disk of a folder before a recording or playback begins."""

    folder: Path
    least_bytes: int

    def expect(self, recording: str) -> None:
        """Raise a DiskError while too little space is free, so that a playback that has begun can be stored."""
        with as_disk_error(recording):
            free = shutil.disk_usage(self.folder).free
        if free < self.least_bytes:
            raise DiskError(
                recording, f"{free // MEBIBYTE} MiB are free, {self.least_bytes // MEBIBYTE} MiB are kept free"
            )


@dataclass(frozen=True)
class Reopened:
    """A recording as read from its files, its playbacks and its rigs."""

    recording: Recording
    runs: Runs
    descriptions: dict[str, rig_pb2.RigDescription]

    @property
    def ended(self) -> bool:
        """Whether its last step is stored."""
        return self.recording.order.ended


def is_ended(folder: Path, name: str) -> bool:
    """Return whether a recording is complete, from the end of its last file."""
    summary = read_summary(files_of(folder, name)[-1])
    return summary is not None and summary.ended


def reopen(
    folder: Path, name: str, *, keep_original: bool = True, reason: str = KILLED, least_free_bytes: int = 0
) -> Reopened | None:
    """Reopen a recording; a file without an end is repaired."""
    files = files_of(folder, name)
    if stranded := files_after_a_gap(folder, name):
        missing = recording_path(folder, name, number=len(files) + 1)
        raise _unreadable(name, stranded[0], f"the file {missing.name} is missing before it")
    if not files:
        return None
    content, unfinished = Content(), not is_finished(files[-1])
    try:
        known = _seed(content, files[:-1] if unfinished else files, name)
        for path in files[known : -1 if unfinished else None]:
            content.begin_file()
            scan(path, content.take)
            _expect_own(content.part, name, path)
        if unfinished:
            content.begin_file()
            if keep_original:
                _expect_room_for_copy(files[-1], least_free_bytes)
            if not _repair(files[-1], content, name=name, keep_original=keep_original, reason=reason):
                _put_aside(files.pop())
    except DAMAGE as error:
        raise _unreadable(name, files[-1], reason_of(error)) from error
    if not files:
        return None
    if not content.steps:
        raise _unreadable(name, files[-1], "it holds no step")
    if content.step_numbers != list(range(len(content.steps))):
        raise _unreadable(name, files[-1], "a step is missing in it")
    summary = content.summary_now(name, reason=reason)
    order = StepOrder(name)
    order.restore(summary.step_types, summary.step_hashes)
    stored = Stored(
        files=len(files),
        attachments=summary.attachments,
        scenario=content.scenario,
        story=summary.story,
        streams=summary.streams,
    )
    recording = Recording(name, folder, order=order, stored=stored)
    if (last := read_summary(files[-1])) is not None and last.next_file:
        # The summary names a next file, and readers look for it.
        recording.write_empty_file(summary.runs, reason=reason)
    return Reopened(recording, summary.runs, content.descriptions)


def _expect_own(part: Mapping[str, str], name: str, path: Path) -> None:
    """Refuse a copy: it would claim the playbacks of the original recording."""
    if newer := newer_format(part):
        raise _unreadable(name, path, newer)
    if (own := part.get("recording", name)) != name:
        raise _unreadable(name, path, f"it is a copy of recording {own!r}")


def _seed(content: Content, files: Sequence[Path], name: str) -> int:
    """Read the summary of the last finished file; return the number of files that need not be read because of it."""
    for number in range(len(files), 0, -1):
        summary = read_summary(files[number - 1])
        if summary is None or len(summary.step_types) != len(summary.step_hashes) or not summary.step_types:
            continue
        _expect_own({"recording": summary.recording}, name, files[number - 1])
        _take_over(content, summary)
        for path in files[:number]:
            content.scenario = last_metadata(path, SCENARIO_METADATA) or content.scenario
            for message in messages_on(path, STEP_TOPIC + rig_pb2.RigDescription.DESCRIPTOR.name):
                description = rig_pb2.RigDescription.FromString(message.data)
                content.descriptions[description.rig] = description
        return number
    return 0


def _take_over(content: Content, summary: Summary) -> None:
    steps = zip(summary.step_types, summary.step_hashes, strict=True)
    content.steps = dict(enumerate(steps))
    content.attachments = dict(summary.attachments)
    content.story = summary.story
    content.streams = dict(summary.streams)
    for (rig, name), run in summary.runs.items():
        content.planned.append(recorder_pb2.RunPlanned(run=name, rig=rig))
        if run.played is not None:
            content.played.append(run.played)
        for epoch, continuity in run.epochs.items():
            content.blocks[rig, name, epoch] = continuity


def _repair(path: Path, content: Content, *, name: str, keep_original: bool, reason: str) -> bool:
    """Write the end of a file; return False if the file has no message, so that there is nothing to end."""
    check_begin(path)
    found = scan(path, content.take)
    _expect_own(content.part, name, path)
    if not content.messages:
        return False
    size = path.stat().st_size
    if keep_original:
        _keep(path)
    finish(path, found, metadata={SUMMARY_METADATA: content.summary_now(name, reason=reason).to_metadata()})
    structlog.get_logger("recorder").warning(
        "a file without an end was repaired",
        recording=name,
        file=path.name,
        steps=len(content.steps),
        cut_off_bytes=size - found.end,
        why=reason,
    )
    return True


def _expect_room_for_copy(path: Path, least_free_bytes: int) -> None:
    """Raise OSError if a copy would use space that must stay free, before the file is read."""
    free, size = shutil.disk_usage(path.parent).free, path.stat().st_size
    if free < size + least_free_bytes:
        raise OSError(
            errno.ENOSPC,
            f"{free // MEBIBYTE} MiB are free, a copy of {path.name} takes {size // MEBIBYTE} MiB and "
            f"{least_free_bytes // MEBIBYTE} MiB are kept free",
        )


def _free_place(path: Path) -> Path:
    """Return an unused name in the folder of damaged files."""
    folder = path.parent / DAMAGED_FOLDER
    folder.mkdir(exist_ok=True)
    sync_folder(path.parent)
    place, number = folder / path.name, 1
    while place.exists():
        number += 1
        place = folder / f"{path.name}.{number}"
    return place


def _keep(path: Path) -> None:
    place = _free_place(path)
    temporary = place.with_name(place.name + ".copying")
    try:
        with path.open("rb") as source, temporary.open("wb") as copy:
            while block := source.read(MEBIBYTE):
                # Zeros that a power cut left use no space in the copy either.
                if block.strip(b"\0"):
                    copy.write(block)
                else:
                    copy.seek(len(block), os.SEEK_CUR)
            copy.truncate(source.tell())
            copy.flush()
            os.fsync(copy.fileno())
        temporary.replace(place)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(place.parent)


def _put_aside(path: Path) -> None:
    """Move a file without any step to the damaged files: nothing in it was acknowledged, so its name is free again."""
    place = _free_place(path)
    structlog.get_logger("recorder").warning("a file without any step is put aside", file=path.name, kept_as=place.name)
    path.replace(place)
    sync_folder(path.parent)


def _unreadable(name: str, path: Path, why: str) -> RefusedError:
    return RefusedError(
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
        f"There is a recording {name!r} from before ({path.name}) that cannot be gone on with: {why}; choose another "
        "id.",
        field="recording",
    )
