"""One open recording: its file, the order of its steps, and what is written about it at its end."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Final

from google.protobuf.message import Message

from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from recorder.mcap_log import McapLog
from recorder.refused import RefusedError
from recorder.run_book import PlannedRun
from recorder.step_order import Placement, StepOrder
from recorder.step_types import Step

STEP_TOPIC: Final = "step/"
"""Committed steps are on `step/<short name of the message>`, numbered by their sequence."""

EPOCH: Final = "epoch"
"""Entry of a stream channel's metadata: the epoch of its publisher."""

SOFTWARE_METADATA: Final = "software"
SCENARIO_METADATA: Final = "scenario"
SUMMARY_METADATA: Final = "summary"


def software_versions() -> dict[str, str]:
    """Return what wrote the recording."""
    packages = ("duralab-recorder", "duralab-proto", "mcap", "protobuf")
    return {"python": platform.python_version()} | {package: version(package) for package in packages}


class Recording:
    """A recording that is written. Used by one thread.

    Parameters
    ----------
    name : str
        Its id.
    path : Path
        Its file, which must not exist.

    Raises
    ------
    OSError
        The file cannot be created; nothing is left behind.
    """

    def __init__(self, name: str, path: Path) -> None:
        self.name = name
        self.order = StepOrder(name)
        self._log = McapLog(path)
        self._failure = ""
        self._write(lambda: self._log.add_metadata(SOFTWARE_METADATA, software_versions()))

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._log.bytes_written

    def place(self, step: Step) -> Placement:
        """Decide what is to be done with a step; see `StepOrder.place`."""
        if self._failure:
            raise self._broken()
        return self.order.place(step)

    def store(self, step: Step) -> None:
        """Write a step that was found new, and return when it is on the disk."""

        def write() -> None:
            if isinstance(step.message, iterator_pb2.CampaignSpec):
                self._log.add_metadata(SCENARIO_METADATA, {"campaign": step.message.id, "yaml": step.message.scenario})
            kind = type(step.message)
            self._log.add_message(STEP_TOPIC + kind.DESCRIPTOR.name, step.payload, kind=kind, sequence=step.number)
            self._log.sync()

        self._write(write)
        self.order.store(step)

    def add_stream(self, key: str, message: Message, *, epoch: int, seq: int) -> None:
        """Write a message of a stream under its key; it is on the disk after the next `sync`."""
        self._write(
            lambda: self._log.add_message(
                key,
                message.SerializeToString(),
                kind=type(message),
                sequence=seq,
                metadata={EPOCH: str(epoch)},
            )
        )

    def sync(self) -> None:
        """Return when all that was added is on the disk."""
        self._write(self._log.sync)

    def close(self, runs: Mapping[tuple[str, str], PlannedRun], *, reason: str) -> None:
        """Write what is known about the whole and close the file; the file is let go of in any case."""

        def write() -> None:
            self._log.add_metadata(SUMMARY_METADATA, self._summary(runs, reason=reason))
            self._log.close()

        try:
            self._write(write)
        finally:
            self._log.release()

    def abandon(self) -> None:
        """Remove the file: nothing in it was promised to anyone."""
        self._log.abandon()

    def _summary(self, runs: Mapping[tuple[str, str], PlannedRun], *, reason: str) -> dict[str, str]:
        return {
            "recording": self.name,
            "reason": reason,
            "steps": str(self.order.count),
            "step_hashes": json.dumps(self.order.hashes),
            "signal_blocks": str(sum(run.stored for run in runs.values())),
            "missing_blocks": str(sum(run.missing for run in runs.values())),
        }

    def information(self, runs: Mapping[tuple[str, str], PlannedRun]) -> recorder_pb2.RecordingInfo:
        """Return the contract's description of it as it stands."""
        return recorder_pb2.RecordingInfo(
            recording=self.name,
            steps=self.order.count,
            bytes=self.bytes_written,
            closed=False,
            signal_blocks=sum(run.stored for run in runs.values()),
            missing_blocks=sum(run.missing for run in runs.values()),
            file=self._log.path.name,
        )

    def _write(self, write: Callable[[], None]) -> None:
        # After one failed write nobody knows what is on the disk, so nothing more is promised about this file.
        if self._failure:
            raise self._broken()
        try:
            write()
        except OSError as error:
            self._failure = error.strerror or str(error)
            raise self._broken() from error

    def _broken(self) -> RefusedError:
        return RefusedError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Recording {self.name!r} could not be written ({self._failure}) and takes nothing more; "
            "free the disk and start a new recording.",
            field="recording",
        )
