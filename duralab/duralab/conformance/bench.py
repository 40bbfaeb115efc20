"""Rig under a conformance check: requests to it, and all messages that it publishes."""

from __future__ import annotations

import secrets
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from duralab_bus import Bus, FaultError, StreamItem
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2


class Outcome(StrEnum):
    """Outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Finding:
    """Result of one check; `sentence` is the reason of a failure, or why it was not tried, else empty."""

    check: str
    outcome: Outcome
    sentence: str = ""


class BreachError(Exception):
    """The rig breaks the contract; the message is the sentence."""


class NotTriedError(Exception):
    """The check does not apply, or would not be safe; the message is the sentence."""


def expect(condition: bool, sentence: str) -> None:
    """Raise BreachError if a condition is false."""
    if not condition:
        raise BreachError(sentence)


def all_passed(findings: Iterable[Finding]) -> bool:
    """Return whether no check failed; a check that was not tried is not a failure."""
    return all(finding.outcome is not Outcome.FAILED for finding in findings)


#: Longest wait for due answers and stream messages.
PATIENCE_SECONDS: Final = 5.0
#: Longest wait for lost signal blocks, which are requested again; this is slow on a busy machine.
REPAIR_SECONDS: Final = 20.0


class Bench:
    """Subscriptions and requests of one rig; it subscribes before any request. Must be closed."""

    def __init__(self, bus: Bus, rig: str, *, seconds: float) -> None:
        self.bus = bus
        self.rig = rig
        #: Length of the test drives in s.
        self.seconds = seconds
        self.description = rig_pb2.RigDescription()
        self.states: list[StreamItem[rig_pb2.RigState]] = []
        self.blocks: list[StreamItem[rig_pb2.SignalBlock]] = []
        self.poses: list[StreamItem[rig_pb2.PoseBlock]] = []
        self.problems: list[str] = []
        self._changed = threading.Condition()
        # Unique for every check, so that no name was played before.
        self._prefix = f"check-{uuid.uuid4().hex[:12]}"
        self._count = 0
        keys = bus.keys
        self._signal = bus.subscribe(
            keys.rig_signal(rig, "*"), rig_pb2.SignalBlock, self._keep(self.blocks), self._on_problem, repair=True
        )
        self._subscriptions = [
            self._signal,
            bus.subscribe(keys.rig_state(rig), rig_pb2.RigState, self._keep(self.states), self._on_problem),
            bus.subscribe(keys.rig_pose(rig), rig_pb2.PoseBlock, self._keep(self.poses), self._on_problem),
        ]

    def close(self) -> None:
        """Close the subscriptions."""
        for subscription in self._subscriptions:
            subscription.close()

    def new_run(self) -> str:
        """Return the name of a run that was never played."""
        self._count += 1
        return f"{self._prefix}.{self._count:02d}"

    def describe(self) -> rig_pb2.RigDescription:
        """Query the description."""
        return self.bus.query(
            self.bus.keys.rig_description(self.rig), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
        )

    def state(self) -> rig_pb2.RigState:
        """Query the state."""
        return self.bus.query(self.bus.keys.rig_state(self.rig), rig_pb2.StateRequest(), rig_pb2.RigState)

    def stop(self, reason: str) -> rig_pb2.RigState:
        """Stop the rig."""
        return self.bus.query(self.bus.keys.rig_stop(self.rig), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)

    def reset(self) -> rig_pb2.RigState:
        """Reset the rig."""
        return self.bus.query(
            self.bus.keys.rig_reset(self.rig), rig_pb2.ResetRequest(command=secrets.token_hex(16)), rig_pb2.RigState
        )

    def play(
        self,
        run: str,
        drive: np.ndarray,
        *,
        real_time: bool = False,
        channels: Sequence[array_pb2.Channel] | None = None,
        sample_rate: float | None = None,
        on_progress: Callable[[query_pb2.Progress], None] | None = None,
    ) -> rig_pb2.PlayResult:
        """Play a drive (drives, samples), by default with the description's channels and rate."""
        record = array_pb2.Record(
            channels=self.description.drives if channels is None else channels,
            sample_rate=self.description.sample_rate if sample_rate is None else sample_rate,
            samples=to_array(np.ascontiguousarray(drive)),
        )
        request = rig_pb2.PlayRequest(run=run, drive=record, seed=1, real_time=real_time)
        return self.bus.query(self.bus.keys.rig_play(self.rig), request, rig_pb2.PlayResult, on_progress=on_progress)

    def blocks_of(self, run: str) -> list[StreamItem[rig_pb2.SignalBlock]]:
        """Return the received signal blocks of a run, in order."""
        with self._changed:
            return [item for item in self.blocks if item.key.rpartition("/")[2] == run]

    def lost_blocks(self, run: str, epoch: int) -> int:
        """Return the number of lost signal blocks of a run that the rig no longer keeps."""
        proof = self._signal.proof(self.bus.keys.rig_signal(self.rig, run), epoch)
        return sum(gap.stop - gap.start for gap in proof.lost)

    def modes(self) -> list[tuple[rig_pb2.RigMode, str]]:
        """Return the modes and runs published so far."""
        with self._changed:
            return [(item.message.mode, item.message.run) for item in self.states]

    def wait(self, condition: Callable[[], bool], seconds: float = PATIENCE_SECONDS) -> bool:
        """Wait until a condition becomes true; return whether it is true."""
        deadline = time.monotonic() + seconds
        while not condition():
            with self._changed:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return condition()
                self._changed.wait(min(left, 0.05))
        return True

    def _keep(self, items: list) -> Callable[[StreamItem], None]:
        def keep(item: StreamItem) -> None:
            with self._changed:
                items.append(item)
                self._changed.notify_all()

        return keep

    def _on_problem(self, fault: FaultError) -> None:
        with self._changed:
            self.problems.append(fault.message)


def check_numbering(items: Iterable[StreamItem], what: str) -> None:
    """Check that a stream has one epoch and no missing, repeated or misordered item."""
    expected: tuple[int, int] | None = None
    for item in items:
        if expected is not None and (item.epoch, item.seq) != expected:
            raise BreachError(
                f"the {what} has the number {item.seq} of epoch {item.epoch} where {expected[1]} of epoch "
                f"{expected[0]} is due; numbers go up by one within one epoch."
            )
        expected = (item.epoch, item.seq + 1)
