"""The order of a recording's steps: without a gap, each stored once, none after the last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.format import Step
from recorder.refused import RefusedError


class Placement(Enum):
    """What is to be done with a step."""

    NEW = auto()
    """It is the next one: store it."""
    STORED = auto()
    """It is stored already: acknowledge it."""


@dataclass(frozen=True)
class _Stored:
    type_name: str
    payload_hash: str


class StepOrder:
    """The steps stored so far.

    `recording`: Id of the recording, for the refusals.
    """

    def __init__(self, recording: str) -> None:
        self._recording = recording
        self._steps: list[_Stored] = []

    @property
    def count(self) -> int:
        """Number of steps stored, which is the number of the next one."""
        return len(self._steps)

    @property
    def hashes(self) -> tuple[str, ...]:
        """SHA-256 (hexadecimal) of each step's payload."""
        return tuple(step.payload_hash for step in self._steps)

    @property
    def types(self) -> tuple[str, ...]:
        """Full name of each step's message."""
        return tuple(step.type_name for step in self._steps)

    def restore(self, types: Sequence[str], hashes: Sequence[str]) -> None:
        """Take over the steps that the recording's files hold, in order."""
        self._steps = [_Stored(*step) for step in zip(types, hashes, strict=True)]

    @property
    def ended(self) -> bool:
        """Whether the last step, RecordingClosed, is stored."""
        return bool(self._steps) and self._steps[-1].type_name == recorder_pb2.RecordingClosed.DESCRIPTOR.full_name

    def place(self, step: Step) -> Placement:
        """Decide what is to be done with a step; nothing is changed."""
        if step.number < self.count:
            if self._steps[step.number] == _Stored(step.type_name, step.payload_hash):
                return Placement.STORED
            raise RefusedError(
                query_pb2.FAULT_CODE_ALREADY_EXISTS,
                f"Step {step.number} of recording {self._recording!r} is stored with another content; "
                f"a stored step is never changed, and the next one is {self.count}.",
                field="step",
            )
        if self.ended:
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Recording {self._recording!r} is closed with {self.count} steps; commit to a new one.",
                field="recording",
            )
        if step.number > self.count:
            raise RefusedError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Step {step.number} of recording {self._recording!r} leaves a gap; the next step is {self.count}.",
                field="step",
            )
        return Placement.NEW

    def store(self, step: Step) -> None:
        """Note that a step that `place` found NEW is on disk."""
        self._steps.append(_Stored(step.type_name, step.payload_hash))
