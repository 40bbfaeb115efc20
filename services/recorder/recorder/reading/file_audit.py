"""Audit of a recording for completeness: checksums, steps, hashes, signal blocks, the chain of its files."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from mcap.records import Footer

from duralab_proto.keys import run_of
from duralab_proto.v1 import recorder_pb2
from duralab_recordings import (
    DAMAGE,
    BlockPlace,
    RecordingError,
    RecordReader,
    block_places,
    check_begin,
    hash_of_blocks,
    newer_format,
    reason_of,
)
from recorder.format import Content, sha256_of, type_name_of

_MAGIC_BYTES: Final = 8
_FOOTER_CRC_BYTES: Final = 4
_BLOCK_BYTES: Final = 1024 * 1024


@dataclass
class Audit:
    """Findings of an audit of a recording."""

    findings: list[str] = field(default_factory=list)
    content: Content = field(default_factory=Content)
    read_whole: bool = True
    """Whether its last file was read to its end."""

    @property
    def missing_blocks(self) -> int:
        """Number of blocks that were announced as played and are missing."""
        return sum(self._missing_of(played) for played in self.content.played)

    def _missing_of(self, played: recorder_pb2.RunPlayed) -> int:
        continuity = self.content.blocks.get((played.rig, played.run, played.epoch))
        return played.blocks if continuity is None else sum(len(gap) for gap in continuity.missing(played.blocks))

    def judge(self) -> None:
        """Add a finding for each inconsistency."""
        content = self.content
        numbers = content.step_numbers
        if numbers != list(range(len(numbers))):
            gap = next(number for number, found in enumerate([*numbers, -1]) if number != found)
            self.findings.append(f"Step {gap} is missing, though step {numbers[-1]} is there.")
        if not self.read_whole:
            self.findings.append(f"What follows, if anything does, was not read; {len(numbers)} steps lie before it.")
        elif content.last_step_type != type_name_of(recorder_pb2.RecordingClosed):
            self.findings.append(f"The last of its {len(numbers)} steps is not RecordingClosed: it was cut short.")
        for played in content.played:
            if missing := self._missing_of(played):
                self.findings.append(f"Run {played.run!r} lacks {missing} of its {played.blocks} signal blocks.")
        known = {(played.rig, played.run, played.epoch) for played in content.played}
        for place, continuity in content.blocks.items():
            if place not in known and (lost := continuity.missing(continuity.next_seq)):
                count = sum(len(gap) for gap in lost)
                self.findings.append(
                    f"A playback of run {place[1]!r} that did not end lacks {count} blocks before its last."
                )
        for (_, run, _), samples in content.samples.items():
            if samples.finding:
                self.findings.append(f"The samples of run {run!r} do not join: {samples.finding}.")
        self._compare()

    def _compare(self) -> None:
        """Compare the content with the summary that was written when the last file was closed."""
        content, summary = self.content, self.content.summary
        if summary is None:
            return
        if tuple(content.steps[number][1] for number in content.step_numbers) != summary.step_hashes:
            self.findings.append("The steps are not those whose hashes were noted when the recording was closed.")
        for name in sorted(summary.attachments.keys() | content.attachments.keys()):
            if content.attachments.get(name) != summary.attachments.get(name):
                self.findings.append(f"The attachment {name!r} is not the one that was noted at the end.")
        if summary.next_file:
            self.findings.append(f"The file {summary.next_file} is missing, with which the recording goes on.")


def audit(files: Sequence[Path], *, name: str = "") -> Audit:
    """Read a recording from its first byte to its last, with all checksums, in bounded memory."""
    found = Audit()
    before: Path | None = None
    for number, path in enumerate(files, start=1):
        _read_file(found, path)
        _check_place(found, path, number=number, before=before, name=name)
        before = path
    found.judge()
    _check_samples(found, files)
    return found


def _check_samples(found: Audit, files: Sequence[Path]) -> None:
    """Compare the signal blocks of runs with the hashes in the steps that leave the samples to them."""
    places: dict[tuple[str, int], list[BlockPlace]] = {}
    try:
        for path in files if found.content.named else ():
            for topic, epoch, place in block_places(path):
                places.setdefault((run_of(topic), epoch), []).append(place)
        for run, epoch, samples_hash in found.content.named:
            if hash_of_blocks(places.get((run, epoch), ())) != samples_hash:
                found.findings.append(f"The samples of run {run!r} are not those of the hash that its step names.")
    except RecordingError as error:
        found.findings.append(f"The samples of its runs cannot be compared with their steps: {error.reason}.")


def _read_file(found: Audit, path: Path) -> None:
    found.content.begin_file()
    footer: Footer | None = None
    first = found.content.messages
    before = len(found.findings)
    found.read_whole = False
    try:
        check_begin(path)
        with path.open("rb") as stream:
            for record in RecordReader(stream).records:
                if isinstance(record, Footer):
                    footer = record
                else:
                    found.content.take(record)
            if footer is not None and not _index_is_sound(stream, footer):
                found.findings.append(f"The index at the end of {path.name} is damaged.")
            if more := os.fstat(stream.fileno()).st_size - stream.tell():
                found.findings.append(f"The file {path.name} has {more} bytes after its end.")
        found.read_whole = True
    except DAMAGE as error:
        messages = found.content.messages - first
        # All messages were read: only the last bytes of an MCAP file are missing.
        found.read_whole = footer is not None
        reason = "it does not end as an MCAP file" if found.read_whole else reason_of(error)
        found.findings.append(f"The file {path.name} is damaged or ends after {messages} messages: {reason}.")
    except MemoryError:
        # The reader trusts a length inside a chunk; a flipped bit makes it larger than any memory.
        found.findings.append(f"The file {path.name} is damaged: a length in it is impossible.")
    if footer is None and len(found.findings) == before:
        found.findings.append(f"The file {path.name} ends without its index.")


def _check_place(found: Audit, path: Path, *, number: int, before: Path | None, name: str) -> None:
    """Check the position of a file in the recording: it follows the file whose hash it names."""
    part = found.content.part
    if newer := newer_format(part):
        found.findings.append(f"The file {path.name} is not understood: {newer}.")
    if part.get("number") not in (str(number), None if number == 1 else ""):
        found.findings.append(f"The file {path.name} says that it is number {part.get('number')!r}, not {number}.")
    if name and (own := part.get("recording", name)) != name:
        found.findings.append(f"The file {path.name} is a copy: it says that it belongs to recording {own!r}.")
    if before is not None and part.get("previous_sha256") != sha256_of(before):
        found.findings.append(f"The file {before.name} is not the one that {path.name} follows: its hash differs.")


def _index_is_sound(stream: IO[bytes], footer: Footer) -> bool:
    """Check the checksum of the index, which the streaming reader skips; the file was read to its end."""
    end = stream.tell()
    covered = range(footer.summary_start, end - _MAGIC_BYTES - _FOOTER_CRC_BYTES)
    # A start of 0 means that there is no index; the recorder always writes one.
    if not 0 < covered.start < covered.stop:
        return False
    stream.seek(covered.start)
    checksum = 0
    for first in range(covered.start, covered.stop, _BLOCK_BYTES):
        checksum = zlib.crc32(stream.read(min(_BLOCK_BYTES, covered.stop - first)), checksum)
    stream.seek(end)
    return checksum == footer.summary_crc
