"""Live view rebuilt from a recorded log, in the order of the log, by the code that draws during recording."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from google.protobuf.message import Message
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, McapRecord, Schema
from mcap.records import Message as Record

from duralab_proto.v1 import identifier_pb2, iterator_pb2, rig_pb2, sequencer_pb2
from duralab_recordings import (
    DAMAGE,
    RecordReader,
    Unfinished,
    ZerosError,
    check_begin,
    is_finished,
    reason_of,
    scan,
)
from recorder.live.view import LiveView

SHOWN: Final[dict[str, type[Message]]] = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (
        iterator_pb2.CampaignEvent,
        iterator_pb2.CampaignSpec,
        iterator_pb2.CampaignStatus,
        iterator_pb2.IterationStep,
        iterator_pb2.TargetInBand,
        identifier_pb2.Model,
        rig_pb2.PoseBlock,
        rig_pb2.RigDescription,
        rig_pb2.RigState,
        rig_pb2.SignalBlock,
        sequencer_pb2.EnduranceCorrection,
        sequencer_pb2.EnduranceDecision,
        sequencer_pb2.EnduranceHold,
        sequencer_pb2.EnduranceRepeat,
        sequencer_pb2.EnduranceSpec,
        sequencer_pb2.EnduranceStatus,
        sequencer_pb2.EnduranceVolume,
    )
}
"""Messages that the view draws, by the names of their schemas."""

_NANOSECONDS: Final = 1e9
_DATA_END_BYTES: Final = 4


class UnreadableFileError(Exception):
    """A file that is damaged or not part of a recording; its text states which and the remedy, without a full stop."""


@dataclass
class Shown:
    """Shown part of a recording.

    `messages`: Number of drawn messages. `cut`: Files without an end, which are shown up to the first damage.
    """

    messages: int = 0
    cut: list[Path] = field(default_factory=list)


def show_log(view: LiveView, files: Sequence[Path]) -> Shown:
    """Show the content of a recording and verify all checksums; files of a killed recorder are shown as far as whole.

    `view`: View to draw into. `files`: Files of the recording, in their order.
    Returns: Amount of what was shown.
    Raises `UnreadableFileError`: A file is damaged or not a recording's; the data before the damage is shown.
    `OSError`: A file cannot be read.
    """
    shown = Shown()
    for path in files:
        decoder, before = _Decoder(), shown.messages

        def take(record: McapRecord, decoder: _Decoder = decoder) -> None:
            decoded = decoder.decode(record)
            if decoded is not None:
                shown.messages += 1
                _show(view, *decoded)

        try:
            check_begin(path)
            found = scan(path, take)
            if is_finished(path):
                _check_end(path, found)
            else:
                shown.cut.append(path)
        except DAMAGE as error:
            raise _unreadable(path, error, messages=shown.messages - before) from error
    return shown


def recording_of(files: Sequence[Path]) -> str:
    """Return the id of the recording that the files hold; if they name none, the first file's name.

    `files`: Files of the recording, in their order.
    Returns: Id of the recording.
    Raises `UnreadableFileError`: A file is damaged, or not a recording's, before it names its recording.
    `OSError`: A file cannot be read.
    """
    for path in files:
        try:
            if name := _named_in(path):
                return name
        except (*DAMAGE, MemoryError) as error:
            raise _unreadable(path, error) from error
    return files[0].stem


def _named_in(path: Path) -> str:
    decoder = _Decoder()
    check_begin(path)
    with path.open("rb") as stream:
        try:
            for record in RecordReader(stream).records:
                match decoder.decode(record):
                    case iterator_pb2.CampaignSpec() as specification, _ if specification.id:
                        return specification.id
        except (EndOfFile, ZerosError, struct.error):
            # The file of a killed recorder; `show_log` reports any damage.
            return ""
    return ""


def _show(view: LiveView, message: Message, at: datetime) -> None:
    match message:
        case rig_pb2.SignalBlock():
            view.show_block(message)
        case rig_pb2.PoseBlock():
            view.show_pose(message)
        case rig_pb2.RigState():
            view.show_state(message, at=at)
        case iterator_pb2.CampaignEvent():
            view.show_status(message.status, at=at)
        case _:
            view.show_step(message)


class _Decoder:
    """Decodes the messages of one file that the view draws."""

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self._kinds: dict[int, type[Message] | None] = {}

    def decode(self, record: McapRecord) -> tuple[Message, datetime] | None:
        """Return the message of a record and the time when it was stored."""
        match record:
            case Schema():
                self._schemas[record.id] = record.name
            case Channel():
                self._kinds[record.id] = SHOWN.get(self._schemas.get(record.schema_id, ""))
            case Record():
                kind = self._kinds.get(record.channel_id)
                if kind is not None:
                    return kind.FromString(record.data), datetime.fromtimestamp(record.log_time / _NANOSECONDS, UTC)
        return None


def _check_end(path: Path, found: Unfinished) -> None:
    """Raise one of DAMAGE if a finished file was not read up to its end, or differs from what was written."""
    with path.open("rb") as stream:
        stream.seek(found.end)
        data = ReadDataStream(stream)
        if (data.read1(), data.read8()) != (Opcode.DATA_END, _DATA_END_BYTES):
            raise McapError(f"the record at byte {found.end} is not what was written")
        # 0 if the writer computed no checksum.
        if DataEnd.read(data).data_section_crc not in (0, found.crc):
            raise McapError("its checksum does not match its contents")


def _unreadable(path: Path, error: Exception, *, messages: int = 0) -> UnreadableFileError:
    if isinstance(error, InvalidMagic):
        return UnreadableFileError(
            f"{path.name} is no recording, {reason_of(error)}; give the recording's .mcap files, the first one first"
        )
    return UnreadableFileError(
        f"{path.name} is damaged after {messages} of the messages that are drawn ({reason_of(error)}); `verify` of "
        "the recorder says more, and another copy of the file may be whole"
    )
