"""Recordings of one endurance test, one after the other; each holds a bounded number of repeats."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from google.protobuf.message import Message

from duralab_bus import Bus, FaultError, RecordingLog, recorded_steps
from duralab_proto.keys import LONGEST_NAME
from duralab_proto.v1 import query_pb2, recorder_pb2

LONGEST_ID: Final = LONGEST_NAME - len(".r9999999-999")
"""Largest number of characters of an id: its runs and its recordings have longer names."""


def volume_name(id: str, number: int) -> str:
    """Return the id of the recording with this number, from 1, of an endurance test."""
    return id if number == 1 else f"{id}-v{number:04d}"


def run_name(id: str, repeat: int, *, attempt: int = 1) -> str:
    """Return the name of a repeat on the rig; a further attempt after a refusal by the rig has a number."""
    return f"{id}.r{repeat:07d}" + (f"-{attempt}" if attempt > 1 else "")


class EnduranceLog:
    """Commits the steps of one endurance test; used by one thread.

    `volume`: Number of the recording that is written. `next_step`: Number of the first step to store in it. `stop`:
    Event that ends the waiting for a missing recorder or a full disk.
    """

    def __init__(
        self,
        bus: Bus,
        id: str,
        *,
        volume: int = 1,
        next_step: int = 0,
        stop: threading.Event,
        on_wait: Callable[[str], None],
    ) -> None:
        self._bus = bus
        self._id = id
        self._stop = stop
        self._on_wait = on_wait
        self.volume = volume
        self._log = self._opened(next_step)

    def _opened(self, next_step: int = 0) -> RecordingLog:
        return RecordingLog(
            self._bus,
            self.recording,
            next_step=next_step,
            stop=self._stop,
            on_wait=self._on_wait,
            outlasts_recorder=True,
        )

    @property
    def recording(self) -> str:
        """Id of the recording that is written."""
        return volume_name(self._id, self.volume)

    @property
    def next_step(self) -> int:
        """Number of the next step in the recording."""
        return self._log.next_step

    def commit(self, message: Message) -> None:
        """Store a step durably; wait while the recorder is away or has no room."""
        self._log.commit(message)

    def begin_volume(self) -> None:
        """Close the recording; the next step is the first of the next one."""
        following = volume_name(self._id, self.volume + 1)
        self._log.commit(recorder_pb2.RecordingClosed(reason=f"The endurance test goes on in {following}."))
        self.next_volume()

    def next_volume(self) -> None:
        """Continue in the next recording; the one before is closed."""
        self.volume += 1
        self._log = self._opened()

    def close(self, last: Message, *, reason: str) -> None:
        """Store the last message and close the recording."""
        self._log.close(last, reason=reason)


def last_volume(bus: Bus, id: str) -> int:
    """Return the number of the last recording of an endurance test; 0 if there is none."""
    low, step = 0, 1
    while is_recorded(bus, volume_name(id, low + step)):
        low, step = low + step, 2 * step
    while step > 1:
        step //= 2
        if is_recorded(bus, volume_name(id, low + step)):
            low += step
    return low


def is_recorded(bus: Bus, recording: str) -> bool:
    """Return whether a recording exists."""
    try:
        # Not the description of the recording, which needs a hash of every file.
        next(recorded_steps(bus, recording), None)
    except FaultError as fault:
        if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
            return False
        raise
    return True
