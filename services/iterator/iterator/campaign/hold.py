"""Hold points of one campaign: a proposal is stored, a person decides, the decision is stored and applied."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import structlog

from duralab_bus import Call, FaultError, OpenHold, RecordingLog
from duralab_proto.arrays import to_array
from duralab_proto.decisions import revised_specification
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2
from duralab_settings import Decision, HoldPoint, SettingsError
from duralab_settings.messages import from_message
from iterator.assessment import level_of
from iterator.campaign.messages import checked_model
from iterator.campaign.plan import CampaignPlan, invalid, plan_campaign
from iterator.campaign.proposals import proposal_message
from iterator.campaign.resumption import Resumption, require_same_drive_map
from iterator.campaign.specimen_cost import identification_damage
from iterator.holds import Basis, ProposedPlayback, Revision, hold_reason
from iterator.model import RigModel


class EndedAtHoldPointError(Exception):
    """End of the campaign by a person's decision; the message is one sentence."""


@dataclass(frozen=True)
class _Revised:
    """A campaign after a decision: its plan, and the changes of the loop."""

    plan: CampaignPlan
    revision: Revision | None = None
    identified: RigModel | None = None
    adds_target: bool = False


@dataclass(frozen=True)
class _Answer:
    decision: iterator_pb2.Decision
    revised: _Revised


class Holds:
    """The hold points of a campaign. `decide` is called on the campaign's thread, `answer` on any.

    `plan`: Checked plan. `log`: Log of proposals and decisions. `before`: Steps done before. `stop`: Event that ends
    the waiting. `on_wait`: Called with a proposal when the campaign waits for a decision on it, and with None and the
    waited time in s when the decision has come.
    """

    def __init__(
        self,
        plan: CampaignPlan,
        *,
        log: RecordingLog,
        before: Resumption,
        stop: threading.Event,
        on_wait: Callable[[iterator_pb2.Proposal | None, float], None],
    ) -> None:
        self.plan = plan
        """The plan in use: that of the specification, with the later decisions applied."""
        self._log = log
        self._on_wait = on_wait
        self._proposals, self._decisions = deque(before.proposals), deque(before.decisions)
        self._last_number = max((proposal.number for proposal in before.proposals), default=0)
        self._stored_targets = max(1, before.targets)
        self._own_playbacks_from = plan.spec.parent_iteration + 1
        self._model: identifier_pb2.Model | None = None
        self._identified: RigModel | None = None
        self._revised_playback = 0
        self._open = OpenHold[iterator_pb2.Proposal, _Answer](stop)

    @property
    def are_possible(self) -> bool:
        """Whether the campaign may wait, or has waited, for a decision."""
        return self.plan.hold.when is not HoldPoint.NEVER

    def begin(self, model: identifier_pb2.Model, identified: RigModel) -> None:
        """Set the model that the iteration starts from."""
        self._model, self._identified = model, identified

    def decide(self, number: int, proposed: ProposedPlayback | None) -> Revision | None:
        """Return the changes of a decision before a playback, or None to play it; see `iterator.holds.Decide`."""
        if proposed is None:
            return self._decided_before(number)
        reason = self._reason(proposed)
        if not reason:
            return None
        proposal = self._stored(proposed, reason)
        if self._decisions and self._decisions[0].proposal == proposal.number:
            decision = self._decisions.popleft()
            return self._applied(decision, self._revised(decision))
        return self._waited_for(proposal)

    def _decided_before(self, number: int) -> Revision | None:
        """Return the next revision before a recorded playback."""
        while self._proposals and self._proposals[0].playback <= number:
            self._proposals.popleft()
        while self._decisions and self._decisions[0].playback <= number:
            decision = self._decisions.popleft()
            if (revision := self._applied(decision, self._revised(decision))) is not None:
                return revision
        return None

    def _reason(self, proposed: ProposedPlayback) -> str:
        """Return why the campaign waits; a change or a step back is always followed by another proposal."""
        if self._revised_playback == proposed.number:
            return "The drive was made again by a decision"
        is_first = proposed.number == self._own_playbacks_from
        if proposed.forecast is None:
            return "" if self.plan.hold.when is HoldPoint.FIRST and not is_first else "No drive could be made"
        return hold_reason(
            self.plan.hold,
            is_first=is_first,
            forecast=proposed.forecast,
            stop=self.plan.settings.stop,
            level=proposed.level,
            names=self.plan.controlled_names,
        )

    def _stored(self, proposed: ProposedPlayback, reason: str) -> iterator_pb2.Proposal:
        """Return the stored proposal: the recorded one if the drive is the same again."""
        replaces = 0
        if self._proposals:
            recorded = self._proposals.popleft()
            proposal = proposal_message(proposed, number=recorded.number, reason=reason, plan=self.plan)
            proposal.replaces = recorded.replaces
            if proposal.SerializeToString(deterministic=True) == recorded.SerializeToString(deterministic=True):
                return recorded
            # Another machine may compute other last bits. The decision was on another drive, so it must be made again.
            structlog.get_logger("iterator").warning(
                "A recorded proposal differs from the drive made again; it is proposed again.", proposal=recorded.number
            )
            if any(decision.HasField("control_band") for decision in self._decisions):
                raise _refused(
                    f"Proposal {recorded.number} was recorded with another drive than is made now, and a decision after"
                    " it changes the control band; resume the campaign on the machine that it ran on.",
                    field="id",
                )
            self._proposals.clear()
            self._decisions.clear()
            replaces = recorded.replaces or recorded.number
        self._last_number += 1
        proposal = proposal_message(proposed, number=self._last_number, reason=reason, plan=self.plan)
        proposal.replaces = replaces
        self._log.commit(proposal)
        return proposal

    def _waited_for(self, proposal: iterator_pb2.Proposal) -> Revision | None:
        """Wait for a decision, store it and return its changes."""
        begun = time.monotonic()
        self._open.open(proposal)
        self._on_wait(proposal, 0.0)

        def store(answer: _Answer) -> None:
            answer.decision.decided = time.time_ns()
            self._log.commit(answer.decision)
            self._on_wait(None, time.monotonic() - begun)

        answer = self._open.decided(store)
        return self._applied(answer.decision, answer.revised)

    def _applied(self, decision: iterator_pb2.Decision, revised: _Revised) -> Revision | None:
        """Apply a stored decision; raises EndedAtHoldPointError if it ends the campaign."""
        if decision.kind == iterator_pb2.DECISION_KIND_END:
            raise EndedAtHoldPointError(
                f"Ended at the hold point before playback {decision.playback} by {decision.name}: {decision.reason}"
            )
        self.plan = revised.plan
        self._identified = revised.identified or self._identified
        if revised.adds_target and revised.plan.judged_target >= self._stored_targets:
            self._log.commit(iterator_pb2.TargetInBand(samples=to_array(revised.plan.target_in_band)))
            self._stored_targets += 1
        if revised.revision is not None:
            self._revised_playback = decision.playback
        return revised.revision

    def answer(self, decision: iterator_pb2.Decision, call: Call) -> None:
        """Check an untrusted decision; return when it is stored."""
        try:
            from_message(decision, Decision)
        except SettingsError as error:
            raise invalid(str(error), field=error.field) from error
        proposal = self._require_open(decision.proposal)
        if proposal.refusal and decision.kind == iterator_pb2.DECISION_KIND_PLAY:
            raise _refused(
                f"Proposal {proposal.number} has no drive ({proposal.refusal.rstrip('.')}); change settings, go back "
                "or end.",
                field="kind",
            )
        own = iterator_pb2.Decision()
        own.CopyFrom(decision)
        own.playback = proposal.playback
        answer = _Answer(own, self._revised(own))
        self._open.bring(proposal, answer, call, not_open=lambda: self._not_open(decision.proposal))

    def _require_open(self, number: int) -> iterator_pb2.Proposal:
        proposal = self._open.hold
        if proposal is None or proposal.number != number:
            raise self._not_open(number)
        return proposal

    def _not_open(self, number: int) -> FaultError:
        """Return the fault for a late or repeated decision."""
        id, proposal = self.plan.spec.id, self._open.hold
        waits = f"waits for one on proposal {proposal.number}" if proposal else "waits for no decision now"
        return _refused(
            f"The decision is on proposal {number} and campaign {id!r} {waits}; look at its status, and decide on what "
            "it shows.",
            field="proposal",
        )

    def _revised(self, decision: iterator_pb2.Decision) -> _Revised:
        """Return the campaign after a decision; raises FaultError if the campaign does not allow it."""
        plan = self.plan
        if decision.kind == iterator_pb2.DECISION_KIND_BACK:
            self._require_way_back(decision)
            return _Revised(plan, Revision(from_iteration=decision.from_iteration))
        if decision.kind != iterator_pb2.DECISION_KIND_CHANGE:
            return _Revised(plan)
        model, identified = self._model, self._identified
        if model is None or identified is None:
            raise AssertionError("A campaign waits after its identification.")
        changed = plan_campaign(revised_specification(plan.spec, decision), plan.description, plan.experiment)
        require_same_drive_map(plan.settings.update, changed.settings.update)
        if not np.array_equal(plan.response_weight > 0.0, changed.response_weight > 0.0):
            raise invalid(
                "update.weights watches other responses than before (weight 0); keep these at a hold point, or resume "
                "the campaign as a new one.",
                field="update.weights",
            )
        same_band = plan.settings.update.band == changed.settings.update.band
        if not same_band or not np.array_equal(plan.response_weight, changed.response_weight):
            identified = checked_model(model, plan=changed)
        changed = replace(changed, judged_target=plan.judged_target + (not same_band))
        basis = Basis(
            changed.target_in_band,
            identified,
            changed.settings,
            identification_damage(model, plan=changed),
            changed.target_damage,
        )
        return _Revised(changed, Revision(basis), identified, adds_target=not same_band)

    def _require_way_back(self, decision: iterator_pb2.Decision) -> None:
        number, levels = decision.from_iteration, self.plan.settings.levels
        if not number < decision.playback:
            raise invalid(
                f"from_iteration is {number}; before playback {decision.playback} there are {decision.playback - 1} to "
                "go back to.",
                field="from_iteration",
            )
        before, now = level_of(number + 1, levels), level_of(decision.playback, levels)
        if before != now:
            raise invalid(
                f"from_iteration is {number}, whose successor is played at {100 * before:.0f} % of the target, and "
                f"playback {decision.playback} at {100 * now:.0f} %; go back to a later one.",
                field="from_iteration",
            )


def _refused(message: str, *, field: str) -> FaultError:
    return FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, message, field=field)
