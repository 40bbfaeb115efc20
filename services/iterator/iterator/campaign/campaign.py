"""One campaign from its specification to its last step: identify, iterate, and store each step before the next."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import structlog
from numpy.typing import NDArray

from duralab_bus import SAMPLES_LACK, Bus, Call, FaultError, RecordingLog, SpanKind, early_end, halt_rig, span
from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2
from iterator.assessment import Forecast, IterationMetrics, Outcome, PlaybackBoundError, best_at_full_level
from iterator.campaign import seeds
from iterator.campaign.confirmation import confirmation_message, confirmed
from iterator.campaign.hold import EndedAtHoldPointError, Holds
from iterator.campaign.identification import (
    identification_request,
    identification_run,
    request_at_target,
    run_at_target,
)
from iterator.campaign.known_before import first_drive_metrics
from iterator.campaign.messages import (
    OUTCOMES,
    StepT,
    checked_drive_map,
    checked_model,
    metrics_message,
    recorded_playback,
    run_played,
    step_message,
    with_samples,
)
from iterator.campaign.plan import CampaignPlan
from iterator.campaign.progress_estimate import ProgressEstimate
from iterator.campaign.proposals import proposal_in_words, without_samples
from iterator.campaign.remarks import map_remarks, remarks_of
from iterator.campaign.resumption import Resumption
from iterator.campaign.rig_playback import RigPlayback, words_of
from iterator.campaign.specimen_cost import (
    budget_remarks,
    identification_damage,
    identification_remarks,
    require_budget,
)
from iterator.campaign.status_board import CampaignBoard
from iterator.holds import ProposedPlayback, Revision
from iterator.iteration_loop import iterate
from iterator.limits import DriveLimitError, DriveOverrunError
from iterator.playbacks import NOTHING_KNOWN, Iteration, KnownBefore

_PAUSED: Final = "paused"


@dataclass(frozen=True)
class _Storing:
    """A playback that is stored while the next drive is computed. `show`: Shows it to the clients once it is stored."""

    activity: str
    stored: Future[None]
    show: Callable[[], None]


class Campaign:
    """Runs one campaign on a separate thread. A motion is requested once and never repeated.

    `plan`: Checked plan. `bus`: Bus of rig, identifier and recorder. `board`: Status board for the clients. `on_end`:
    Called on the campaign's thread when the rig is free again, before the final status is shown. `resumption`: Steps
    done before; none if not given. `known`: Knowledge of the rig before the first playback.
    """

    def __init__(
        self,
        plan: CampaignPlan,
        *,
        bus: Bus,
        board: CampaignBoard,
        on_end: Callable[[], None],
        resumption: Resumption | None = None,
        known: KnownBefore = NOTHING_KNOWN,
    ) -> None:
        self._bus = bus
        self._board = board
        self._on_end = on_end
        self._id = plan.spec.id
        self.rig = plan.spec.rig
        self._before = resumption or Resumption()
        self._known = known
        self._journal = structlog.get_logger("iterator").bind(campaign=self._id, rig=self.rig)
        self._stop = threading.Event()
        self._log = RecordingLog(
            bus, self._id, next_step=self._before.steps, stop=self._stop, on_wait=self._show_waiting
        )
        self._holds = Holds(plan, log=self._log, before=self._before, stop=self._stop, on_wait=self._show_proposal)
        self._stop_reason = ""
        self._latching = self._latched = False
        self._step = "starting"
        self._playback = RigPlayback(plan, bus=bus, log=self._log, planned=self._before.planned, cancel=self._stop)
        self._estimate = ProgressEstimate(
            identification_seconds=plan.experiment.duration_seconds,
            playback_seconds=plan.target_in_band.shape[1] / plan.description.sample_rate,
            iterations=plan.settings.stop.iterations + plan.spec.confirmations,
        )
        self._metrics: list[IterationMetrics] = []
        self._best: Iteration | None = None
        self._storage = ThreadPoolExecutor(1, thread_name_prefix=f"storage-{self._id}")
        self._storing: _Storing | None = None
        self._stored_activity = ""

    @property
    def _plan(self) -> CampaignPlan:
        """The plan in use; a decision at a hold point changes it."""
        return self._holds.plan

    def start(self) -> None:
        """Start the campaign's thread and return at once."""
        self._board.start_publishing(f"campaign-status-{self._id}")
        threading.Thread(target=self._run, name=f"campaign-{self._id}", daemon=True).start()

    def stop(self, reason: str, *, latch: bool = True) -> None:
        """Request the end of the campaign and return at once: a playback is interrupted, no further step begins.

        `reason`: Reason as text, kept in the recording. `latch`: Latch the rig in any state, also between two
        playbacks. Otherwise only an interrupted playback latches it.
        """
        # Before the event: the campaign's thread may end as soon as the event is set.
        self._latching = self._latching or latch
        if not self._stop.is_set():
            self._stop_reason = reason
            self._stop.set()

    def decide(self, decision: iterator_pb2.Decision, call: Call) -> None:
        """Apply a decision on the open proposal; return when it is stored."""
        self._holds.answer(decision, call)

    def _run(self) -> None:
        fault = FaultError(query_pb2.FAULT_CODE_INTERNAL, "The iterator ended in a way of its own; its log says more.")
        final = self._final_fault(fault)
        try:
            final = self._performed()
        except Exception:  # noqa: BLE001 - whatever it is, the campaign must not stay open forever
            self._journal.exception("The campaign could not be brought to its end.", step=self._step)
        finally:
            self._journal.info("campaign ended", how=final.activity)
            self._storage.shutdown()
            self._on_end()
            self._board.end(final)

    def _performed(self) -> iterator_pb2.CampaignStatus:
        """Do all steps, bring the rig to rest, and return the final status."""
        final = self._ended()
        if self._latching and not self._latched:
            # Stopped when no motion was left to interrupt.
            self._halt(final)
        return final

    def _ended(self) -> iterator_pb2.CampaignStatus:
        """Do all steps, and return the final status once the recording is closed."""
        try:
            outcome = self._sequence()
        except FaultError as fault:
            return self._broken_off(fault)
        except Exception as error:  # noqa: BLE001 - the rig has to be brought to rest whatever went wrong
            self._journal.exception("The campaign failed by a defect.", step=self._step)
            defect = f"A defect of the iterator ({type(error).__name__}: {error}); its log says more."
            return self._broken_off(FaultError(query_pb2.FAULT_CODE_INTERNAL, defect))
        return self._finished(outcome)

    def _sequence(self) -> Outcome:
        """Do all remaining steps; return why the iteration ended."""
        plan = self._plan
        beginning = (
            ("specification", plan.spec),
            ("rig's description", plan.description),
            ("target", iterator_pb2.TargetInBand(samples=to_array(plan.target_in_band))),
        )
        for what, message in beginning[self._log.next_step :]:
            with self._doing(f"storing the {what}"):
                self._log.commit(message)
        model = self._before.model
        if model is not None:
            self._go_on_after(model)
        model = self._identified(model)
        with self._doing("inverting the model"):
            start = checked_model(model, plan=plan)
            self._holds.begin(model, start)
            first = self._known.first_drive
            corrects = first is not None and (first.of_this_target or first.response is None)
            drive_map = checked_drive_map(model, start, plan=plan, corrects=corrects)
            self._board.add_remarks([f"Identification: {warning.sentence}" for warning in model.warnings])
            self._board.show_first_drive(first_drive_metrics(self._known, start, plan=plan))
            self._board.add_remarks(map_remarks(model.drive_map))
            recorded = [recorded_playback(step, plan=plan) for step in self._before.iterations]
            spent_before = identification_damage(model, plan=plan)
            if not plan.spec.known.HasField("model"):
                self._board.add_remarks(identification_remarks(spent_before, plan=plan))
            if not recorded:
                require_budget(spent_before, plan=plan)
        iterations = iterate(
            self._play,
            plan.target_in_band,
            model=start,
            settings=plan.settings,
            limits=plan.limits,
            recorded=recorded,
            drive_map=drive_map,
            identification_damage=spent_before,
            target_damage=plan.target_damage,
            on_forecast=self._foretell,
            decide=self._decide if self._holds.are_possible else None,
            known=self._known,
        )
        try:
            try:
                outcome = self._iterated(iterations, recorded=len(recorded))
            finally:
                self._finish_storing()
        except EndedAtHoldPointError as ended:
            outcome = self._ended_at_hold_point(str(ended))
        self._board.add_remarks(budget_remarks(outcome, tuple(self._metrics), plan=self._plan))
        if self._best is not None:
            self._confirm(outcome, self._best)
        return outcome

    def _iterated(self, iterations: Iterator[Iteration], *, recorded: int) -> Outcome:
        """Make, store and show every playback; return why the iteration ended.

        A playback is stored while the next drive is computed, and before anything of that drive is shown or played.
        """
        while True:
            computing = f"computing the drive of {self._iteration_name()}"
            with self._doing(computing, phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING):
                last = self._next(iterations)
            plan = self._plan
            activity = f"storing {self._iteration_name()}"
            self._metrics.append(last.metrics)
            best_number = best_at_full_level(
                tuple(self._metrics), plan.settings.levels, outcome=last.outcome, since=last.comparable_from - 1
            )
            if best_number == last.number:
                self._best = last
            warnings = self._playback.played.warnings if last.number > recorded else ()
            remarks = remarks_of(last, plan=plan, recorded=self._before.iterations, warnings=warnings)
            message = metrics_message(last, plan=plan)
            show = partial(self._board.add_iteration, message, best_iteration=best_number, remarks=remarks)
            if last.number > recorded:
                with self._doing(activity, share=1.0):
                    step = step_message(last, self._playback.played, plan=plan)
                    stored = self._storage.submit(self._store_beside, activity, step, last)
                    self._storing = _Storing(activity, stored, show)
                self._estimate.step_done()
            else:
                self._estimate.step_was_done()
                show()
            if last.outcome is not None:
                return last.outcome

    def _store_beside(self, activity: str, step: iterator_pb2.IterationStep, made: Iteration) -> None:
        """Store a playback, on the storage thread."""
        self._stored_activity = activity
        try:
            with span(activity, SpanKind.MATHEMATICS):
                self._store_playback(step, drive=made.drive, response=made.response)
        finally:
            self._stored_activity = ""

    def _finish_storing(self) -> None:
        """Wait until the last playback is stored and show it; raises the fault if it could not be stored."""
        storing, self._storing = self._storing, None
        if storing is None:
            return
        try:
            storing.stored.result()
        except BaseException:
            self._step = storing.activity
            raise
        storing.show()

    def _decide(self, number: int, proposed: ProposedPlayback | None) -> Revision | None:
        """Return the changes of a decision before a playback; callback of the iteration."""
        self._finish_storing()
        return self._holds.decide(number, proposed)

    def _ended_at_hold_point(self, sentence: str) -> Outcome:
        """End by a decision: with the best playback so far, or as stopped if there is none."""
        self._board.add_remarks([f"{sentence.rstrip('.')}."])
        if self._best is None:
            self.stop(sentence, latch=False)
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, sentence)
        return Outcome.ENDED_AT_HOLD_POINT

    def _store_playback(self, step: StepT, *, drive: NDArray[np.float64], response: NDArray[np.float64]) -> StepT:
        """Store a playback; its samples are left to its run, or stored with it if the recorder lacks some."""
        whole = with_samples(step, description=self._plan.description, drive=drive, response=response)
        try:
            self._log.commit(step)
        except FaultError as fault:
            if (fault.code, fault.field) != SAMPLES_LACK:
                raise
            self._journal.warning(
                "A step is stored with its samples.", step=self._shown_step, run=step.run, why=fault.message
            )
            self._log.commit(whole)
        self._log.commit(run_played(step, rig=self.rig))
        return whole

    def _go_on_after(self, model: identifier_pb2.Model) -> None:
        """Store the copied steps and the missing RunPlayed steps of the earlier attempt."""
        before, identifying = self._before, iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING
        phase = identifying if self._lacks_experiment(model) else iterator_pb2.CAMPAIGN_PHASE_ITERATING
        with self._doing("reading back what was done", phase=phase):
            self._journal.info("The campaign goes on.", playbacks=len(before.iterations), parent=self._plan.spec.parent)
            for message in before.copies:
                self._log.commit(message)
            # A crash may have come between a result and the RunPlayed of its run; the runs of copied results are in the
            # parent's recording.
            for result in (model, *before.iterations, *before.confirmations):
                if result.run in before.planned and result.run not in before.played:
                    self._log.commit(run_played(result, rig=self.rig))

    def _identified(self, before: identifier_pb2.Model | None) -> identifier_pb2.Model:
        """Play the experiments of the identification that are not done yet; return the model for the iteration."""
        plan, spec = self._plan, self._plan.spec
        known, share = spec.known.HasField("model"), 1.0 - plan.share_at_target
        model = before
        if model is None and known:
            with self._doing("storing the model", phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING):
                model = spec.known.model
                self._log.commit(model)
        elif model is None:
            activity = f"identifying {self.rig}"
            with self._doing(activity, phase=iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING):
                run = self._playback.announce(identification_run(spec), purpose="identification")
                request = identification_request(spec, run=run, check_only=False, map_weight=plan.map_weight)
                model = self._experiment(request, self._follower(activity, to=share))
        if self._lacks_experiment(model):
            activity = f"identifying {self.rig} at the target"
            with self._doing(activity, phase=iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING, share=share):
                run = self._playback.announce(run_at_target(spec), purpose="identification at the target")
                request = request_at_target(plan, run=run, model=model)
                model = self._experiment(request, self._follower(activity, begin=share))
        if before is None:
            self._estimate.step_done()
        else:
            self._estimate.step_was_done()
        return model

    def _lacks_experiment(self, model: identifier_pb2.Model) -> bool:
        """Return whether the experiment at the target is still to come after a model."""
        spec = self._plan.spec
        return spec.HasField("at_target") and not spec.known.HasField("model") and not model.shaped_by

    def _experiment(
        self, request: identifier_pb2.IdentifyRequest, on_progress: Callable[[query_pb2.Progress], None]
    ) -> identifier_pb2.Model:
        """Play one experiment on the rig, and store and return its model."""
        with self._playback.motion(request.run):
            model = self._bus.query(
                self._bus.keys.identify(self.rig),
                request,
                identifier_pb2.Model,
                on_progress=on_progress,
                cancel=self._stop,
            )
        if model.rig_content_hash != self._plan.description.content_hash:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"The rig {self.rig!r} is not the one the campaign was checked against: it was changed "
                "since; start the campaign again.",
            )
        with self._doing("storing the model"):
            self._log.commit(model)
            self._log.commit(run_played(model, rig=self.rig))
        return model

    def _next(self, iterations: Iterator[Iteration]) -> Iteration:
        try:
            return next(iterations)
        except DriveLimitError as error:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="update.iteration_gain"
            ) from error
        except DriveOverrunError as error:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="target") from error
        except PlaybackBoundError as error:
            name = self._plan.description.responses[error.passed.response].name
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                error.sentence(name),
                field=f"stop.{error.passed.quantity.value}",
            ) from error
        except ValueError as error:
            self._journal.exception("The core refused.", step=self._step)
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error

    def _foretell(self, forecast: Forecast) -> None:
        """Show the predicted error of the next playback before it is played."""
        self._finish_storing()
        error = forecast.metrics.overall_relative_rms_error
        self._board.show(f"predicted error of {self._iteration_name()}: {100 * error:.1f} %", self._estimate.at(0.0))

    def _play(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Play a drive on the rig; callback of the iteration."""
        self._finish_storing()
        number, outer = len(self._metrics) + 1, self._step
        activity = f"playing {self._iteration_name()} on {self.rig}"
        with self._doing(activity):
            response = self._playback.play(
                drive,
                stem=f"{self._id}.i{number:02d}",
                purpose=self._iteration_name(),
                seed_index=seeds.playback(number),
                on_progress=self._follower(activity),
            )
        self._step = outer
        return response

    def _confirm(self, outcome: Outcome, best: Iteration) -> None:
        """Play the best drive again the requested number of times, and show the repeatability of the rig."""
        recorded = self._before.confirmations
        for _ in recorded:
            self._estimate.step_was_done()
        for shown in confirmed(
            best, plan=self._plan, outcome=outcome, metrics=self._metrics, recorded=recorded, play=self._again
        ):
            self._board.add_confirmation(shown.repeatability, metrics=shown.metrics, remarks=shown.remarks)

    def _again(self, best: Iteration, number: int) -> iterator_pb2.ConfirmationStep:
        """Play the best drive again and store the playback; return the step with its samples."""
        plan, name = self._plan, f"confirmation {number} of {self._plan.spec.confirmations}"
        activity = f"playing {name} on {self.rig}"
        with self._doing(activity, phase=iterator_pb2.CAMPAIGN_PHASE_CONFIRMING):
            response = self._playback.play(
                best.drive,
                stem=f"{self._id}.confirm{number:02d}",
                purpose=name,
                seed_index=seeds.confirmation(number),
                on_progress=self._follower(activity),
            )
        in_band = plan.settings.update.band.limit_response(response)
        with self._doing(f"storing {name}", share=1.0):
            played = self._playback.played
            step = confirmation_message(
                best.drive, response, in_band, played=played, number=number, iteration=best.number, plan=plan
            )
            whole = self._store_playback(step, drive=best.drive, response=response)
        self._board.add_remarks([f"Confirmation {number}: {sentence}" for sentence in played.warnings])
        self._estimate.step_done()
        return whole

    def _iteration_name(self) -> str:
        return f"iteration {len(self._metrics) + 1} of {self._plan.settings.stop.iterations}"

    @contextmanager
    def _doing(
        self, activity: str, *, phase: iterator_pb2.CampaignPhase | None = None, share: float = 0.0
    ) -> Iterator[None]:
        """Show a step, and name it in a fault that ends it or that comes before the next one."""
        if self._stop.is_set():
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        self._step = activity
        self._board.show(activity, self._estimate.at(share), phase=phase)
        # Queries to other services are nested spans: the rest is the work of the iterator.
        with span(activity, SpanKind.MATHEMATICS):
            yield

    def _follower(self, activity: str, *, begin: float = 0.0, to: float = 1.0) -> Callable[[query_pb2.Progress], None]:
        """Return what shows the progress of a query that takes a step from one share of it to another."""

        def follow(progress: query_pb2.Progress) -> None:
            words = words_of(progress, run=self._playback.moving_run)
            done = self._estimate.at(begin + (to - begin) * min(1.0, max(0.0, progress.fraction)))
            self._board.show(f"{activity}: {words}" if words else activity, done)

        return follow

    def _show_proposal(self, proposal: iterator_pb2.Proposal | None, waited_seconds: float) -> None:
        """Show the open proposal, or that it is decided."""
        self._board.show_proposal(None if proposal is None else without_samples(proposal))
        if proposal is None:
            self._estimate.waited(waited_seconds)
            self._step = f"preparing {self._iteration_name()}"
        else:
            self._step = proposal_in_words(proposal, self._plan.settings.stop)
            self._journal.info("The campaign waits for a decision.", proposal=proposal.number, why=proposal.reason)
        self._board.show(self._step, self._estimate.at(0.0))

    def _show_waiting(self, why: str) -> None:
        """Show that the campaign pauses because its next step cannot be stored yet."""
        step = self._shown_step
        if why and not self._board.snapshot().activity.startswith(_PAUSED):
            self._journal.warning("The campaign waits for its recorder.", step=step, why=why)
        self._board.show(f"{_PAUSED} while {step}: {why}" if why else step, self._estimate.at(0.0))

    @property
    def _shown_step(self) -> str:
        """The step that is being stored, or else the present one."""
        return self._stored_activity or self._step

    def _finished(self, outcome: Outcome) -> iterator_pb2.CampaignStatus:
        final = self._board.final_status(
            iterator_pb2.CAMPAIGN_PHASE_FINISHED,
            f"finished after {len(self._metrics)} iterations: {outcome.value}",
            outcome=OUTCOMES[outcome],
        )
        try:
            self._step = "closing the recording"
            self._log.close(final, reason=final.activity)
        except FaultError as fault:
            # The recorder may hold the end all the same: a second end would report a complete result as failed.
            self._journal.warning("The recording of a finished campaign was not closed.", why=fault.message)
            message = f"{fault.message} All playbacks are made and stored: resume it, and it ends without a motion."
            return self._final_fault(FaultError(fault.code, message, field=fault.field, service=fault.service))
        return final

    def _broken_off(self, fault: FaultError) -> iterator_pb2.CampaignStatus:
        """Bring the rig to rest, close the recording if possible, and return the final status with the fault."""
        final = self._final_fault(fault)
        self._halt(final)
        if self._log.begun:
            try:
                self._log.close(final, reason=final.fault.message)
            except FaultError as error:
                self._journal.warning("The recording stays open.", why=error.message)
        return final

    def _halt(self, final: iterator_pb2.CampaignStatus) -> None:
        """Bring the rig to rest, and latch it if the campaign was stopped."""
        run, self._latched = self._playback.moving_run, self._latching
        halt_rig(self._bus, self.rig, final, run=run, reason=self._stop_reason, latch=self._latching)

    def _final_fault(self, fault: FaultError) -> iterator_pb2.CampaignStatus:
        """Return the final status of a campaign that was stopped or failed."""
        stopped = self._stop_reason if self._stop.is_set() else None
        end = early_end(fault, what="campaign", step=self._step, service=self._bus.service, stopped=stopped)
        failed, was_stopped = iterator_pb2.CAMPAIGN_PHASE_FAULTED, iterator_pb2.CAMPAIGN_PHASE_STOPPED
        phase = failed if stopped is None else was_stopped
        return self._board.final_status(phase, end.activity, fault=end.fault)
