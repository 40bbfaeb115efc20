"""Reading a recording to prove that it is whole: checksums, steps, hashes, signal blocks."""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Footer, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader

from duralab_proto.v1 import recorder_pb2, rig_pb2
from labbus import Continuity
from recorder.recording import EPOCH, STEP_TOPIC, SUMMARY_METADATA

# What the mcap package raises on damaged files besides its own errors.
DAMAGE: Final = (McapError, CRCValidationError, EOFError, struct.error, ValueError, KeyError, IndexError, RuntimeError)

_MAGIC_BYTES: Final = 8
_FOOTER_CRC_BYTES: Final = 4


@dataclass(frozen=True)
class Summary:
    """What a recording says about itself at its end."""

    reason: str
    steps: int
    step_hashes: tuple[str, ...]
    signal_blocks: int
    missing_blocks: int


@dataclass
class Audit:
    """What was found in a recording."""

    findings: list[str] = field(default_factory=list)
    step_hashes: dict[int, str] = field(default_factory=dict)
    last_step_type: str = ""
    # By topic and epoch.
    blocks: dict[tuple[str, int], Continuity] = field(default_factory=dict)
    played: list[recorder_pb2.RunPlayed] = field(default_factory=list)
    summary: Summary | None = None
    footer: Footer | None = None

    @property
    def signal_blocks(self) -> int:
        """Number of different blocks."""
        return sum(continuity.received for continuity in self.blocks.values())

    @property
    def missing_blocks(self) -> int:
        """Number of blocks that were announced as played and are not here."""
        return sum(self._missing_of(played) for played in self.played)

    def _missing_of(self, played: recorder_pb2.RunPlayed) -> int:
        place = f"/rig/{played.rig}/signal/{played.run}"
        for (topic, epoch), continuity in self.blocks.items():
            if topic.endswith(place) and epoch == played.epoch:
                return sum(len(gap) for gap in continuity.missing(played.blocks))
        return played.blocks

    def judge(self) -> None:
        """Add a finding for each thing that does not fit together."""
        numbers = sorted(self.step_hashes)
        if numbers != list(range(len(numbers))):
            gap = next(number for number, found in enumerate([*numbers, -1]) if number != found)
            self.findings.append(f"Step {gap} is missing, though step {numbers[-1]} is there.")
        if self.last_step_type != recorder_pb2.RecordingClosed.DESCRIPTOR.name:
            self.findings.append(f"The last of its {len(numbers)} steps is not RecordingClosed: it was cut short.")
        for played in self.played:
            if missing := self._missing_of(played):
                self.findings.append(f"Run {played.run!r} lacks {missing} of its {played.blocks} signal blocks.")
        if self.summary is not None and tuple(self.step_hashes[number] for number in numbers) != (
            self.summary.step_hashes
        ):
            self.findings.append("The steps are not those whose hashes were noted when the recording was closed.")


def read_summary(path: Path) -> Summary | None:
    """Read what a recording says about itself, through its index; None where it has none."""
    try:
        with path.open("rb") as stream:
            for metadata in SeekingReader(stream).iter_metadata():
                if metadata.name == SUMMARY_METADATA:
                    return _summary_of(metadata)
    except DAMAGE:
        return None
    return None


def _summary_of(metadata: Metadata) -> Summary:
    entries = metadata.metadata
    return Summary(
        reason=entries["reason"],
        steps=int(entries["steps"]),
        step_hashes=tuple(json.loads(entries["step_hashes"])),
        signal_blocks=int(entries["signal_blocks"]),
        missing_blocks=int(entries["missing_blocks"]),
    )


def audit(path: Path) -> Audit:
    """Read a recording from its first byte to its last, with all checksums, in bounded memory.

    Parameters
    ----------
    path : Path
        An MCAP file of the recorder, whole or not.

    Returns
    -------
    Audit
        Without findings where the recording is whole.
    """
    found = Audit()
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    messages = 0
    try:
        with path.open("rb") as stream:
            for record in StreamReader(stream, validate_crcs=True).records:
                match record:
                    case Schema():
                        schemas[record.id] = record.name
                    case Channel():
                        channels[record.id] = record
                    case Message():
                        messages += 1
                        channel = channels[record.channel_id]
                        _take_message(found, record, channel, schemas[channel.schema_id])
                    case Metadata() if record.name == SUMMARY_METADATA:
                        found.summary = _summary_of(record)
                    case Footer():
                        found.footer = record
            if found.footer is not None and not _index_is_sound(path, found.footer):
                found.findings.append("The index at the end of the file is damaged.")
    except (*DAMAGE, DecodeError) as error:
        found.findings.append(f"The file is damaged or ends after {messages} messages: {error}".rstrip(".") + ".")
    except MemoryError:
        # The reader believes a length inside a chunk; a flipped bit makes it larger than any memory.
        found.findings.append(f"The file is damaged after {messages} messages: a length in it is impossible.")
    if found.footer is None and not found.findings:
        found.findings.append("The file ends without its index.")
    found.judge()
    return found


def _take_message(found: Audit, message: Message, channel: Channel, schema: str) -> None:
    if channel.topic.startswith(STEP_TOPIC):
        found.step_hashes[message.sequence] = hashlib.sha256(message.data).hexdigest()
        found.last_step_type = schema.rpartition(".")[2]
        if schema == recorder_pb2.RunPlayed.DESCRIPTOR.full_name:
            found.played.append(recorder_pb2.RunPlayed.FromString(message.data))
    elif schema == rig_pb2.SignalBlock.DESCRIPTOR.full_name:
        place = (channel.topic, int(channel.metadata[EPOCH]))
        found.blocks.setdefault(place, Continuity()).accept(message.sequence)


def _index_is_sound(path: Path, footer: Footer) -> bool:
    """Check the checksum over the index, which the streaming reader passes over."""
    # A start of 0 would say that there is no index; the recorder always writes one.
    if not 0 < footer.summary_start < path.stat().st_size:
        return False
    with path.open("rb") as stream:
        stream.seek(footer.summary_start)
        covered = stream.read()[: -_MAGIC_BYTES - _FOOTER_CRC_BYTES]
    return zlib.crc32(covered) == footer.summary_crc
