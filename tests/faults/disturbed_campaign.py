"""A campaign that a fault hits at a random moment, carried to its end as an operator would, and what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from enum import StrEnum

from duralab_bus import BusError, FaultError
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2

from .lab_under_fault import RIG, LabUnderFault
from .proof import files_of, prove
from .reference import Reference

LIMIT_SECONDS = 120.0
"""No round takes longer after its fault is over, on whatever machine."""

_POLL_SECONDS = 0.05
_SILENCE_SECONDS = 5.0
_BEFORE_ITS_FIRST_STEP = "failed while storing the specification"
"""The specification is the first step: none was acknowledged, and the recorder may know nothing of the campaign."""

_BROKEN_OFF = (iterator_pb2.CAMPAIGN_PHASE_FAULTED, iterator_pb2.CAMPAIGN_PHASE_STOPPED)


class Ending(StrEnum):
    """What it took to bring the campaign to its end."""

    WENT_ON = "went on by itself"
    RESUMED = "resumed in its recording"
    TAKEN_UP = "taken up by a new campaign"
    BEGUN_ANEW = "begun anew: no model was committed yet"


@dataclass
class Round:
    """One fault in one campaign."""

    fault: str
    number: int
    ending: Ending = Ending.WENT_ON
    recovered_seconds: float = 0.0
    lost: int = 0
    doubled: int = 0
    reordered: int = 0
    findings: list[str] = field(default_factory=list)
    """What is wrong, one sentence each; empty where all is well."""
    recordings: list[str] = field(default_factory=list)
    detail: str = ""


Disturb = Callable[[ExitStack], str]
"""Brings the fault, holds it and lifts it; returns it in words. What lasts until the round's end goes on the stack."""


class Operator:
    """Starts a campaign, looks after it and puts right what needs a person."""

    def __init__(self, lab: LabUnderFault, reference: Reference, outcome: Round) -> None:
        self._lab = lab
        self._keys = lab.bus.keys
        self._reference = reference
        self._outcome = outcome
        self._id = f"{outcome.fault}-{outcome.number:02d}".replace(" ", "-")
        self._stem = self._id
        self._never_stored: set[str] = set()

    def start(self, id: str) -> None:
        """Start the campaign under a new name."""
        specification = iterator_pb2.CampaignSpec()
        specification.CopyFrom(self._reference.specification)
        specification.id = id
        self._lab.bus.query(self._keys.campaign_start(specification.rig), specification, iterator_pb2.CampaignStatus)
        self._id = id
        self._outcome.recordings.append(id)

    def perform(self, disturb: Disturb, *, moment: float) -> None:
        """Run the campaign, disturb it after so many seconds, and carry it to its end."""
        with ExitStack() as stack:
            # A service that the round before started anew may still be on its way.
            self._lab.wait_until_whole()
            self.start(self._id)
            time.sleep(moment)
            self._outcome.detail = disturb(stack)
            lifted = time.monotonic()
            self._carry_to_the_end(lifted)
            self._prove()

    def _carry_to_the_end(self, lifted: float) -> None:
        deadline = lifted + LIMIT_SECONDS
        seen: set[tuple[int, str]] = set()
        trouble = "nothing answered"
        while time.monotonic() < deadline:
            time.sleep(_POLL_SECONDS)
            try:
                status = self._status()
                if status is None and self._finished_before():
                    self._outcome.recovered_seconds = time.monotonic() - lifted
                    return
                if status is None or status.phase in _BROKEN_OFF:
                    trouble = status.fault.message if status is not None else "the iterator does not know it"
                    self._go_on(status)
                else:
                    seen.add((status.phase, status.activity))
                if self._outcome.recovered_seconds == 0.0 and (
                    len(seen) > 1 or status is None or status.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
                ):
                    self._outcome.recovered_seconds = time.monotonic() - lifted
                if status is not None and status.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED:
                    return
            except (FaultError, BusError, TimeoutError) as error:
                trouble = str(error)
        self._outcome.findings.append(f"{self._id} did not end within {LIMIT_SECONDS:g} s: {trouble}")

    def _status(self) -> iterator_pb2.CampaignStatus | None:
        """Ask how it stands; None where the iterator does not know it."""
        try:
            return self._lab.bus.query(
                self._keys.campaign(self._id),
                iterator_pb2.CampaignRequest(),
                iterator_pb2.CampaignStatus,
                silence_seconds=_SILENCE_SECONDS,
            )
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
                return None
            raise

    def _finished_before(self) -> bool:
        """Whether the recording says that the campaign was over when its iterator was killed."""
        try:
            answer = self._lab.bus.query(
                self._keys.recording_steps(self._id), recorder_pb2.ReadStepsRequest(), recorder_pb2.RecordedSteps
            )
        except FaultError:
            return False
        kind = iterator_pb2.CampaignStatus
        return any(
            kind.FromString(step.payload).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
            for step in answer.steps
            if step.message_type == kind.DESCRIPTOR.full_name and len(answer.steps) == answer.total
        )

    def _go_on(self, status: iterator_pb2.CampaignStatus | None) -> None:
        """Look at the rig and resume; FaultError where that has to wait."""
        self._lab.wait_until_whole()
        bus = self._lab.bus
        state = bus.query(self._keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)
        if state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
            bus.query(self._keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)
        try:
            self._resume("")
            self._outcome.ending = max(self._outcome.ending, Ending.RESUMED, key=list(Ending).index)
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
                if status is not None and status.activity == _BEFORE_ITS_FIRST_STEP:
                    self._never_stored.add(self._id)
                self._begin_anew()
            elif fault.field == "new_id":
                self._take_up()
            else:
                raise

    def _resume(self, new_id: str) -> None:
        self._lab.bus.query(
            self._keys.campaign_resume(self._id, self._reference.specification.rig),
            iterator_pb2.ResumeCampaignRequest(new_id=new_id),
            iterator_pb2.CampaignStatus,
        )

    def _next_id(self) -> str:
        return f"{self._stem}-again{len(self._outcome.recordings)}"

    def _take_up(self) -> None:
        new_id = self._next_id()
        try:
            self._resume(new_id)
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION and "nothing to resume" in fault.message:
                self._begin_anew()
                return
            raise
        self._id = new_id
        self._outcome.recordings.append(new_id)
        self._outcome.ending = max(self._outcome.ending, Ending.TAKEN_UP, key=list(Ending).index)

    def _begin_anew(self) -> None:
        self.start(self._next_id())
        self._outcome.ending = Ending.BEGUN_ANEW

    def _prove(self) -> None:
        """Ask the recorder whether all is whole, and look for oneself."""
        for name in self._outcome.recordings:
            if name in self._never_stored and not files_of(self._lab.recordings, name):
                continue
            self._outcome.findings += self._verified(name)
            proof = prove(self._lab.recordings, name, rig=RIG)
            self._outcome.lost += proof.lost
            self._outcome.doubled += proof.doubled
            self._outcome.reordered += proof.reordered
            self._outcome.findings += proof.findings
            if name == self._id and tuple(proof.playbacks) != self._reference.playbacks:
                same = [a == b for a, b in zip(proof.playbacks, self._reference.playbacks, strict=False)]
                self._outcome.findings.append(f"{name}: not the bytes of the undisturbed campaign: {same}")
        if lost := self._outcome.lost or self._outcome.doubled or self._outcome.reordered:
            self._outcome.findings.append(f"{lost} blocks are lost, doubled or out of order")

    def _verified(self, name: str) -> list[str]:
        bus, deadline = self._lab.bus, time.monotonic() + LIMIT_SECONDS
        while True:
            try:
                self._lab.wait_until_whole()
                info = bus.query(
                    self._keys.recording(name), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo
                )
                if name == self._id and not info.closed:
                    raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "it is not closed")
                result = bus.query(
                    self._keys.recording_verify(name),
                    recorder_pb2.VerifyRecordingRequest(),
                    recorder_pb2.VerifyResult,
                )
            except FaultError as fault:
                # One that was given up for a new campaign may stay open: its files are read all the same.
                if name != self._id and fault.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION:
                    return []
                if name != self._id and fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
                    # Nothing of it was ever acknowledged.
                    return []
                if time.monotonic() > deadline:
                    return [f"{name} cannot be verified: {fault.message}"]
                time.sleep(_POLL_SECONDS)
                continue
            findings = [f"{name}: {finding}" for finding in result.findings]
            if info.missing_blocks:
                findings.append(f"{name}: the recorder says that {info.missing_blocks} blocks are missing")
            return findings if result.whole else [*findings, f"{name}: not whole"]
