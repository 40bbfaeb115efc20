"""A rig behind a controller that exchanges files: a drive is written, its response is awaited and read."""

from __future__ import annotations

import hashlib
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from duralab_drive_files import AcceptedResponse, DriveFileError, Inbox, Order, Outbox, drive_faults, drive_hash, judged
from duralab_gateway import Approach, PlaybackRig, Run, RunEndedError, complete_description
from duralab_gateway.motion import Block, DrivePlayback, Use
from duralab_proto.v1 import query_pb2, rig_pb2

_POLL_SECONDS = 0.25


class FileRig(PlaybackRig):
    """The rig of a controller map; this process moves nothing itself."""

    watchdogs = ()

    def __init__(self, outbox: Outbox) -> None:
        self.outbox, self.inbox = outbox, Inbox(outbox)
        self.is_leaving = False
        self.stopped = threading.Event()
        controller_map = outbox.map
        # A drive may begin away from zero: the file, or the controller, ramps to it.
        self.approach = Approach(ramp=controller_map.lead_seconds)
        self._description = complete_description(
            rig_pb2.RigDescription(
                rig=controller_map.rig,
                specimen=controller_map.specimen or "not named in the map",
                engine=controller_map.controller or "drive files",
                version=version("duralab-file-rig"),
                sample_rate=controller_map.sample_rate,
                drives=[each.to_message() for each in controller_map.drives],
                responses=[each.to_message() for each in controller_map.responses],
                longest_drive_seconds=controller_map.longest_drive,
                publishes_after_run=True,
                # Hash of the whole map except the folder of the files: another offset is another rig.
                content_hash=hashlib.sha256(repr(replace(controller_map, exchange=Path())).encode()).hexdigest(),
            )
        )

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig."""
        return self._description

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive."""
        if found := list(drive_faults(self.outbox.map, drive)):
            raise RunEndedError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, f"{'; '.join(found)}.", field="drive.samples")
        return _FilePlayback(self, drive, run, self._description)

    def stop(self, reason: str) -> None:
        """End the waiting of a run, not only the request of its commander."""
        self.stopped.set()

    def reset(self) -> None:
        """Prepare for another run."""
        self.stopped.clear()

    def leave(self) -> None:
        """Leave a waiting order for the next process."""
        self.is_leaving = True

    def order_of(self, run: Run, drive: np.ndarray) -> Order:
        """Return the order of a run: a waiting one, one whose answer was lost, or a new one.

        A commander that lost an answer sends the same drive and seed, with the same name or the next one.
        """
        digest, order = drive_hash(drive), self.outbox.waiting()
        if order is not None:
            if order.drive_sha256 == digest:
                return order
            raise DriveFileError(f"run {order.run!r}, of another drive, waits for its response; {order.ways_out}")
        ended = self.outbox.ended()
        same = [each for each in ended if (each.drive_sha256, each.seed) == (digest, run.seed)]
        first, asked = _first_attempt(run.name), {name for each in same for name in each.names}
        for each in same:
            is_attempt = first in asked and first in map(_first_attempt, each.names)
            if each.response_sha256 and (run.name in each.names or is_attempt):
                return each
        if run.name in (each.run for each in ended):
            raise RunEndedError(
                query_pb2.FAULT_CODE_ALREADY_EXISTS,
                f"run {run.name!r} was ordered before; give every playback its own name.",
                field="run",
            )
        return self.outbox.put(run.name, drive, seed=run.seed)


class _FilePlayback(DrivePlayback):
    """A drive that is played elsewhere: its whole response arrives at once."""

    is_paced = False

    def __init__(self, rig: FileRig, drive: np.ndarray, run: Run, description: rig_pb2.RigDescription) -> None:
        super().__init__(
            drive,
            channels=description.drives,
            approach=rig.approach,
            sample_rate=description.sample_rate,
            responses=len(description.responses),
            block_samples=description.block_samples,
        )
        self._rig, self._run = rig, run
        self._next = 0
        self._order: Order | None = None
        self._accepted: AcceptedResponse | None = None

    @property
    def rests_at_zero(self) -> bool:
        """True, because the file or the controller ramps back."""
        return True

    def approach(self) -> Iterator[Block]:
        """Wait for the response; yields nothing."""
        if self._accepted is None:
            try:
                self._accepted = self._wait()
            except DriveFileError as error:
                raise RunEndedError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error
        yield from ()

    def ramp_down(self) -> Iterator[Block]:
        """Move nothing: the run has ended at the controller."""
        self._end("a level was crossed, or it was stopped while its blocks were published")
        yield from ()

    def uses(self) -> list[Use]:
        """Return the peak of every drive: the use of its actuator is not known here."""
        ratios = zip(self._channels, self.peak_ratios(), strict=True)
        return [Use(channel.name, ratio, 0.0, 0.0) for channel, ratio in ratios]

    def complete(self, result: rig_pb2.PlayResult) -> None:
        """Add the alignment of the response; afterwards nothing waits."""
        accepted = self._accepted
        if accepted is None:
            raise AssertionError("an answer without a response")
        result.real_time_factor = 1.0
        result.warnings.extend(accepted.remarks)
        if (found := accepted.alignment) is not None:
            result.alignment.lag, result.alignment.drift = found.lag, found.drift
            for each in zip(accepted.drives, found.gain, found.offset, found.correlation, strict=True):
                drive, gain, offset, correlation = each
                result.alignment.commands.add(drive=drive, gain=gain, offset=offset, correlation=correlation)
        self._end("answered", accepted.sha256, answered_run=self._run.name)

    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        del counted
        asked = commands[:, :-1]
        samples = asked.shape[1]
        response = np.empty((0, samples)) if self._accepted is None else self._accepted.response
        return Block(
            first_sample=first,
            drive=asked,
            response=response[:, first : first + samples],
            following_error=np.zeros((len(asked), samples)),
            monitored=np.empty((0, samples)),
        )

    def _wait(self) -> AcceptedResponse:
        """Return the accepted response; raises RunEndedError if it does not arrive."""
        rig, drive = self._rig, self._drive
        order = self._order = rig.order_of(self._run, drive)
        if order.ended:
            return judged(rig.outbox.map, order, drive, rig.outbox.done / order.response_file)
        while True:
            refused = f"; the one that is there was refused: {rig.inbox.refusal}" if rig.inbox.refusal else ""
            self._run.wait_for(f"the response file {order.response_file}{refused}")
            if reason := rig.inbox.refusal_by_person(order):
                self._end(f"refused: {reason}")
                raise _cancelled(f"run {order.run!r} was refused at the controller: {reason.rstrip('.')}.")
            if (accepted := rig.inbox.take(order, drive)) is not None:
                return accepted
            if self._run.wait_for_stop(_POLL_SECONDS):
                if rig.is_leaving or not rig.stopped.is_set():
                    raise _cancelled(f"run {order.run!r} still waits, but no client waits for it; {order.ways_out}")
                self._end("stopped")
                raise _cancelled(
                    f"run {order.run!r} was stopped while it waited; where the controller plays it, stop it there."
                )

    def _end(self, how: str, response_sha256: str = "", answered_run: str = "") -> None:
        if self._order is not None and not self._order.ended:
            try:
                self._rig.outbox.end(self._order, how, response_sha256=response_sha256, answered_run=answered_run)
            except DriveFileError as error:
                raise RunEndedError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error


def _first_attempt(run: str) -> str:
    return re.sub(r"-[0-9]+$", "", run)


def _cancelled(sentence: str) -> RunEndedError:
    return RunEndedError(query_pb2.FAULT_CODE_CANCELLED, sentence)
