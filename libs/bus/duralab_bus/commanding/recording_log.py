"""Sends the steps of a recording to the recorder: numbered, and each acknowledged before the next."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable
from typing import Final

from google.protobuf.message import Message

from duralab_bus.bus import Bus
from duralab_bus.faults import FaultError
from duralab_bus.queries import OVERDUE
from duralab_proto.v1 import query_pb2, recorder_pb2

_ROOM_RETRY_SECONDS: Final = 1.0
# Two commits for each repeat of an endurance test: Zenoh holds memory of each for this time.
_COMMIT_SECONDS: Final = 60.0
# A step that takes longer to be stored is a pause, and is shown as one.
_SLOW_SECONDS: Final = 1.0


SAMPLES_LACK: Final = (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "payload.samples_hash")
"""Code and field of the fault for a step whose run the recorder does not hold as played."""


_AWAY: Final = frozenset({query_pb2.FAULT_CODE_UNAVAILABLE, query_pb2.FAULT_CODE_DEADLINE_EXCEEDED})


class RecordingLog:
    """Commits the steps of one recording; used by one thread.

    Parameters
    ----------
    bus : Bus
        Bus of the recorder.
    recording : str
        Id of the recording.
    next_step : int
        Number of the first step to store; more than 0 if the recorder already holds some.
    stop : threading.Event, optional
        If given, a step that the recorder's disk has no room for is sent again until it has room or this is set.
    on_wait : callable, optional
        Called with the reason while a step waits, and with an empty string when it is stored.
    outlasts_recorder : bool
        Whether a step is also sent again, until `stop` is set, while the recorder is away: the recorder recognises
        stored steps by number and hash.
    """

    def __init__(
        self,
        bus: Bus,
        recording: str,
        *,
        next_step: int = 0,
        stop: threading.Event | None = None,
        on_wait: Callable[[str], None] | None = None,
        outlasts_recorder: bool = False,
    ) -> None:
        self._bus = bus
        self._recording = recording
        self._next_step = next_step
        self._stop = stop
        self._on_wait = on_wait
        self._waits_for = frozenset({query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED}) | (
            _AWAY if outlasts_recorder else frozenset()
        )

    @property
    def next_step(self) -> int:
        """Number of the next step."""
        return self._next_step

    @property
    def begun(self) -> bool:
        """Whether the recorder holds a step."""
        return self._next_step > 0

    def commit(self, message: Message) -> None:
        """Store a step durably; return when the recorder has acknowledged that it is on disk."""
        self._send(self._next_step, message)
        self._next_step += 1

    def confirm(self, last: Message) -> None:
        """Have the recorder acknowledge the last step again: proof that it continues with this recording."""
        self._send(self._next_step - 1, last)

    def _send(self, step: int, message: Message) -> None:
        # The same message must give the same bytes: the recorder recognises a step that is sent again by its hash.
        payload = message.SerializeToString(deterministic=True)
        acknowledged = self._acknowledged(
            recorder_pb2.CommitRequest(
                recording=self._recording,
                step=step,
                message_type=message.DESCRIPTOR.full_name,
                payload=payload,
            )
        )
        if acknowledged.step != step or acknowledged.payload_hash != hashlib.sha256(payload).hexdigest():
            raise FaultError(
                query_pb2.FAULT_CODE_DATA_LOSS,
                f"The recorder acknowledged step {acknowledged.step} of recording {self._recording!r} with a content "
                f"that differs from step {step} as it was sent.",
            )

    def _acknowledged(self, request: recorder_pb2.CommitRequest) -> recorder_pb2.CommitAck:
        """Send a step; repeat it while the recorder's disk is full or slow or the recorder is away: no step is lost."""
        waited, begun = False, time.monotonic()

        def on_progress(progress: query_pb2.Progress) -> None:
            nonlocal waited
            if progress.phase and time.monotonic() - begun > _SLOW_SECONDS:
                waited = True
                self._tell(progress.phase)

        while True:
            try:
                acknowledged = self._bus.query(
                    self._bus.keys.commit(),
                    request,
                    recorder_pb2.CommitAck,
                    longest_seconds=_COMMIT_SECONDS,
                    on_progress=on_progress,
                )
            except FaultError as fault:
                if (fault.code, fault.field) == OVERDUE:
                    # The recorder still works on the step; it recognises it by number and hash when it is sent again.
                    continue
                if fault.code not in self._waits_for or self._stop is None or self._stop.is_set():
                    raise
                waited = True
                self._tell(fault.message)
                self._stop.wait(_ROOM_RETRY_SECONDS)
                continue
            if waited:
                self._tell("")
            return acknowledged

    def _tell(self, why: str) -> None:
        if self._on_wait is not None:
            self._on_wait(why)

    def close(self, last: Message, *, reason: str) -> None:
        """Store the last message and close the recording."""
        try:
            self.commit(last)
        except FaultError as fault:
            if fault.code != query_pb2.FAULT_CODE_ALREADY_EXISTS:
                raise
            # The step before failed without an answer, but the recorder holds it.
            self._next_step += 1
            self.commit(last)
        self.commit(recorder_pb2.RecordingClosed(reason=reason))
