"""One campaign from its specification to its last step: identify, iterate, and store each step before the next."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import structlog
from numpy.typing import NDArray

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator import seeds
from iterator.campaign_messages import OUTCOMES, checked_model, checked_response, metrics_message, step_message
from iterator.campaign_plan import CampaignPlan
from iterator.drive_limits import DriveLimitError
from iterator.identification import identification_request, identification_run
from iterator.iteration_loop import Iteration, iterate
from iterator.iteration_metrics import IterationMetrics, best_iteration
from iterator.progress_estimate import ProgressEstimate
from iterator.recording_log import RecordingLog
from iterator.rig_halt import bring_to_rest
from iterator.status_board import StatusBoard
from labbus import Bus, FaultError
from spectra import rms


class Campaign:
    """Runs one campaign on a thread of its own. A motion is asked for once and never again.

    Parameters
    ----------
    plan : CampaignPlan
        Checked.
    bus : Bus
        Where rig, identifier and recorder are.
    board : StatusBoard
        Shows the others how it goes.
    on_end : callable
        Called on the campaign's thread when the rig is free again, before the final status shows.
    """

    def __init__(self, plan: CampaignPlan, *, bus: Bus, board: StatusBoard, on_end: Callable[[], None]) -> None:
        self._plan = plan
        self._bus = bus
        self._board = board
        self._on_end = on_end
        self._id = plan.spec.id
        self._rig = plan.spec.rig
        self._log = RecordingLog(bus, self._id)
        self._journal = structlog.get_logger("iterator").bind(campaign=self._id, rig=self._rig)
        self._stop = threading.Event()
        self._stop_reason = ""
        self._step = "starting"
        self._moving_run = ""
        self._estimate = ProgressEstimate(
            identification_seconds=plan.experiment.duration_seconds,
            playback_seconds=plan.target_in_band.shape[1] / plan.description.sample_rate,
            iterations=plan.settings.stop.largest_iterations,
        )
        self._metrics: list[IterationMetrics] = []
        self._played = rig_pb2.PlayResult()

    def start(self) -> None:
        """Begin; return at once."""
        self._board.start_repeating()
        threading.Thread(target=self._run, name=f"campaign-{self._id}", daemon=True).start()

    def stop(self, reason: str) -> None:
        """Ask it to end: a playback is broken off, nothing new is begun. Return at once.

        Parameters
        ----------
        reason : str
            In words; kept in the recording.
        """
        if not self._stop.is_set():
            self._stop_reason = reason
            self._stop.set()

    def _run(self) -> None:
        fault = FaultError(query_pb2.FAULT_CODE_INTERNAL, "The iterator ended in a way of its own; its log says more.")
        final = self._final_fault(fault)
        try:
            final = self._performed()
        except Exception:  # noqa: BLE001 - whatever it is, the campaign must not stay open for ever
            self._journal.exception("The campaign could not be brought to its end.", step=self._step)
        finally:
            self._journal.info("campaign ended", how=final.activity)
            self._on_end()
            self._board.end(final)

    def _performed(self) -> iterator_pb2.CampaignStatus:
        """Do all steps, tidy up, and return the final status."""
        try:
            last = self._sequence()
        except FaultError as fault:
            return self._broken_off(fault)
        except Exception as error:  # noqa: BLE001 - the rig has to be brought to rest whatever went wrong
            self._journal.exception("The campaign failed by a defect.", step=self._step)
            defect = f"A defect of the iterator ({type(error).__name__}: {error}); its log says more."
            return self._broken_off(FaultError(query_pb2.FAULT_CODE_INTERNAL, defect))
        return self._finished(last)

    def _sequence(self) -> Iteration:
        """Do all steps; return the last iteration."""
        plan, spec = self._plan, self._plan.spec
        with self._doing("storing the specification"):
            self._log.commit(spec)
            self._log.commit(plan.description)
            self._log.commit(iterator_pb2.TargetInBand(samples=to_array(plan.target_in_band)))
        model = self._identify()
        self._estimate.step_done()
        # Responses count by how large their targets are, whatever their units.
        weight = 1.0 / rms(plan.target_in_band)
        with self._doing("inverting the model"):
            start = checked_model(model, plan=plan, response_weight=weight)
        iterations = iterate(self._play, plan.target_in_band, model=start, settings=plan.settings, limits=plan.limits)
        last: Iteration | None = None
        while last is None or last.outcome is None:
            computing = f"computing the drive of {self._iteration_name()}"
            with self._doing(computing, phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING):
                last = self._next(iterations)
            with self._doing(f"storing {self._iteration_name()}"):
                self._log.commit(step_message(last, self._played, plan=plan))
            self._metrics.append(last.metrics)
            self._estimate.step_done()
            figures = metrics_message(last.number, last.metrics, plan=plan)
            self._board.add_iteration(figures, best_iteration=best_iteration(tuple(self._metrics)))
        return last

    def _identify(self) -> identifier_pb2.Model:
        plan, spec = self._plan, self._plan.spec
        run = identification_run(spec)
        activity = f"identifying {self._rig}"
        with self._doing(activity, phase=iterator_pb2.CAMPAIGN_PHASE_IDENTIFYING):
            self._log.commit(recorder_pb2.RunPlanned(run=run, rig=self._rig, purpose="identification"))
            with self._motion(run):
                model = self._bus.query(
                    self._bus.keys.identify(),
                    identification_request(spec, check_only=False),
                    identifier_pb2.Model,
                    on_progress=self._follower(activity),
                    cancel=self._stop,
                )
            if model.rig_content_hash != plan.description.content_hash:
                raise FaultError(
                    query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                    f"The rig {self._rig!r} is not the one the campaign was checked against: it was changed "
                    "since; start the campaign again.",
                )
        with self._doing("storing the model"):
            self._log.commit(
                recorder_pb2.RunPlayed(run=run, rig=self._rig, epoch=model.signal_epoch, blocks=model.signal_blocks)
            )
            self._log.commit(model)
        return model

    def _next(self, iterations: Iterator[Iteration]) -> Iteration:
        try:
            return next(iterations)
        except DriveLimitError as error:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="update.iteration_gain"
            ) from error
        except ValueError as error:
            self._journal.exception("The core refused.", step=self._step)
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error

    def _play(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Play a drive on the rig: what the iteration calls."""
        number = len(self._metrics) + 1
        run = f"{self._id}.i{number:02d}"
        activity = f"playing {self._iteration_name()} on {self._rig}"
        with self._doing(activity):
            self._log.commit(recorder_pb2.RunPlanned(run=run, rig=self._rig, purpose=self._iteration_name()))
            with self._motion(run):
                self._played = self._bus.query(
                    self._bus.keys.rig_play(self._rig),
                    rig_pb2.PlayRequest(
                        run=run,
                        drive=to_record(self._plan.description.drives, self._plan.description.sample_rate, drive),
                        seed=seeds.derived_seed(self._plan.spec.seed, seeds.playback(number)),
                    ),
                    rig_pb2.PlayResult,
                    on_progress=self._follower(activity),
                    cancel=self._stop,
                )
            response = checked_response(self._played, run=run, samples=drive.shape[1], plan=self._plan)
        with self._doing(f"storing the playback of {self._iteration_name()}", share=1.0):
            self._log.commit(
                recorder_pb2.RunPlayed(run=run, rig=self._rig, epoch=self._played.epoch, blocks=self._played.blocks)
            )
        return response

    def _iteration_name(self) -> str:
        return f"iteration {len(self._metrics) + 1} of {self._plan.settings.stop.largest_iterations}"

    @contextmanager
    def _doing(
        self, activity: str, *, phase: iterator_pb2.CampaignPhase | None = None, share: float = 0.0
    ) -> Iterator[None]:
        """Show a step, and name it in the fault it may end with; the innermost one counts."""
        if self._stop.is_set():
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        outer, self._step = self._step, activity
        self._board.show(activity, self._estimate.at(share), phase=phase)
        yield
        self._step = outer

    @contextmanager
    def _motion(self, run: str) -> Iterator[None]:
        """Remember that the rig may play this run when what is done here fails."""
        self._moving_run = run
        yield
        self._moving_run = ""

    def _follower(self, activity: str) -> Callable[[query_pb2.Progress], None]:
        def follow(progress: query_pb2.Progress) -> None:
            share = min(1.0, max(0.0, progress.fraction))
            self._board.show(activity, self._estimate.at(share))

        return follow

    def _finished(self, last: Iteration) -> iterator_pb2.CampaignStatus:
        outcome = last.outcome
        if outcome is None:
            raise AssertionError("The last iteration carries the outcome.")
        final = self._board.final_status(
            iterator_pb2.CAMPAIGN_PHASE_FINISHED,
            f"finished after {len(self._metrics)} iterations: {outcome.value}",
            outcome=OUTCOMES[outcome],
        )
        try:
            self._step = "closing the recording"
            self._log.close(final, reason=final.activity)
        except FaultError as fault:
            return self._broken_off(fault)
        return final

    def _broken_off(self, fault: FaultError) -> iterator_pb2.CampaignStatus:
        """Bring the rig to rest, close the recording as far as that goes, and say why."""
        final = self._final_fault(fault)
        if self._moving_run:
            sentence = final.fault.message
            if not bring_to_rest(self._bus, self._rig, run=self._moving_run, reason=sentence):
                final.fault.message = f"{sentence} It is not known whether the rig rests; look at it."
        if self._log.begun:
            try:
                self._log.close(final, reason=final.fault.message)
            except FaultError as error:
                self._journal.warning("The recording stays open.", why=error.message)
        return final

    def _final_fault(self, fault: FaultError) -> iterator_pb2.CampaignStatus:
        """Return the final status of a campaign that was stopped or failed."""
        if self._stop.is_set():
            phase, code = iterator_pb2.CAMPAIGN_PHASE_STOPPED, query_pb2.FAULT_CODE_CANCELLED
            activity = f"stopped while {self._step}"
            sentence = f"The campaign was stopped while {self._step}: {self._stop_reason}"
        else:
            phase, code = iterator_pb2.CAMPAIGN_PHASE_FAULTED, fault.code
            activity = f"failed while {self._step}"
            sentence = f"The campaign failed while {self._step}: {fault.message}"
        return self._board.final_status(
            phase,
            activity,
            fault=query_pb2.Fault(
                code=code, message=sentence, field=fault.field, service=fault.service or self._bus.service
            ),
        )
