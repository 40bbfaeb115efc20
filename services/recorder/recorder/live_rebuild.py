"""What a log holds, shown in a live view: through the same code as while it is recorded, in the order of the log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from google.protobuf.message import Message
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from duralab_proto.v1 import identifier_pb2, iterator_pb2, rig_pb2
from recorder.live_view import LiveView

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
    )
}
"""Messages that the view has a picture of, by the names of their schemas."""

_NANOSECONDS: Final = 1e9


def show_log(view: LiveView, files: Sequence[Path]) -> int:
    """Show what a recording holds, files of a killed recorder as far as they go; return how many messages it was."""
    shown = 0
    for path in files:
        for message, at in _messages(path):
            shown += 1
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
    return shown


def recording_of(files: Sequence[Path]) -> str:
    """Return the id of the recording that the files hold; where they name none, the first file's name."""
    for path in files:
        for message, _ in _messages(path):
            if isinstance(message, iterator_pb2.CampaignSpec) and message.id:
                return message.id
    return files[0].stem


def _messages(path: Path) -> Iterator[tuple[Message, datetime]]:
    schemas: dict[int, str] = {}
    kinds: dict[int, type[Message] | None] = {}
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                match record:
                    case Schema():
                        schemas[record.id] = record.name
                    case Channel():
                        kinds[record.id] = SHOWN.get(schemas.get(record.schema_id, ""))
                    case Record():
                        kind = kinds.get(record.channel_id)
                        if kind is not None:
                            moment = datetime.fromtimestamp(record.log_time / _NANOSECONDS, UTC)
                            yield kind.FromString(record.data), moment
        except EndOfFile:
            # What was being written when its writer was killed; all before it is whole.
            return
