"""One endurance test: every repeat is announced, played once, judged and committed before the next."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import structlog
from numpy.typing import NDArray

from duralab_bus import SAMPLES_LACK, Bus, Call, FaultError, bring_to_rest, described_rig, early_end, halt_rig
from duralab_monitoring import AlarmLevel, Monitor, RepeatVerdict, Statistic
from duralab_proto.arrays import samples_hash, to_array, to_record
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from duralab_schedules import AlarmAction
from sequencer.endurance.drive_corrections import DriveCorrections
from sequencer.endurance.holds import Holds
from sequencer.endurance.messages import alarm_message, column_names, progress_of_events, put_damage, put_statistics
from sequencer.endurance.plan import EndurancePlan
from sequencer.endurance.rig_playback import REFUSALS, RigPlayback
from sequencer.endurance.status_board import EnduranceBoard
from sequencer.endurance.test_log import EnduranceLog, run_name
from sequencer.kept_samples import HeldFiles, HeldRepeat, KeptSamples
from sequencer.tally import EventTally

_DAMAGE: Final = list(Statistic).index(Statistic.DAMAGE)
_PACE_SHARE: Final = 0.05
_PAUSED: Final = "paused"
_BETWEEN: Final = "preparing the next repeat"


@dataclass
class Progress:
    """State of a test on which the next repeat depends.

    `first_repeat`: First repeat of the recording that is written, `volume`. `announced`: A run of the next repeat that
    was announced before a crash, with an unknown end. `hold`: A hold without a decision. `iterating`: A hold with the
    decision to iterate again that is not done. `correcting`: A correction of a drive that was planned before a crash
    and is not counted. `volume_ended`: Whether that recording is closed. `samples`: Repeats of it whose samples are
    stored in a step. `kept`: Number of repeats whose samples are kept completely.
    """

    tallies: list[EventTally]
    monitor: Monitor
    volume: int = 1
    first_repeat: int = 0
    next_step: int = 0
    alarms: int = 0
    kept_before: int = 0
    holds: int = 0
    drives: list[sequencer_pb2.EnduranceDrive] = field(default_factory=list)
    announced: str = ""
    hold: sequencer_pb2.EnduranceHold | None = None
    iterating: sequencer_pb2.EnduranceHold | None = None
    correcting: sequencer_pb2.CorrectionPlanned | None = None
    volume_ended: bool = False
    samples: set[int] = field(default_factory=set)
    kept: int = 0

    @property
    def next_repeat(self) -> int:
        """Number of the next repeat, from 0."""
        return sum(tally.played for tally in self.tallies)


class _EndedByAlarmError(Exception):
    """End by an alarm whose action is stop; the message is its sentence."""


class EnduranceTest:
    """Plays one schedule on a separate thread. A motion is requested once and never repeated.

    `plan`: Checked plan. `before`: Progress made before. `board`: Status board for the clients. `repeats_per_volume`:
    Number of repeats in one recording. `held_files`: Files of held repeats that an alarm may require, in addition to
    memory. `on_end`: Called on the test's thread when the rig is free again, before the final status.
    """

    def __init__(
        self,
        plan: EndurancePlan,
        before: Progress,
        *,
        bus: Bus,
        board: EnduranceBoard,
        repeats_per_volume: int,
        held_files: HeldFiles | None,
        on_end: Callable[[], None],
    ) -> None:
        self._plan = plan
        self._bus = bus
        self._board = board
        self._on_end = on_end
        self._repeats_per_volume = repeats_per_volume
        self.id, self.rig = plan.spec.id, plan.spec.rig
        self._journal = structlog.get_logger("sequencer").bind(endurance_test=self.id, rig=self.rig)
        self._before = before
        self._tallies, self._monitor = before.tallies, before.monitor
        self._kept = KeptSamples(plan.schedule.keep, kept_before=before.kept_before, files=held_files)
        self._alarms = before.alarms
        # The last repeat; None if a person may have changed the specimen since.
        self._last: HeldRepeat | None = None
        # Abort limit that a correction passed while no sequencer watched it, as a sentence.
        self._passed_unwatched = ""
        self._first_repeat, self._attempt = before.first_repeat, 1
        self._stop = threading.Event()
        self._stop_reason, self._latching, self._latched, self._leaving = "", False, False, False
        self._step = "starting"
        self._moving_run = ""
        self._rig = RigPlayback(bus, plan, cancel=self._stop)
        self._log = EnduranceLog(
            bus,
            self.id,
            volume=before.volume,
            next_step=before.next_step,
            stop=self._stop,
            on_wait=self._show_waiting,
        )
        self._corrections = DriveCorrections(
            plan,
            bus=bus,
            log=self._log,
            tallies=self._tallies,
            corrected=before.drives,
            monitor=self._monitor,
            stop=self._stop,
            on_counted=self._show_counted,
        )
        self._holds = Holds(self.id, log=self._log, stop=self._stop, last=before.holds, on_wait=self._show_hold)
        # Mean duration of a repeat, with the largest weight for the last ones.
        self._repeat_seconds = 0.0

    def start(self) -> None:
        """Start the test's thread and return at once."""
        self._board.start_publishing(f"endurance-status-{self.id}")
        threading.Thread(target=self._run, name=f"endurance-{self.id}", daemon=True).start()

    def stop(self, reason: str, *, latch: bool = True) -> None:
        """Request the end and return at once: a repeat is interrupted, no further step begins, the rig is latched."""
        # Before the event: the test's thread may end as soon as the event is set.
        self._latching = self._latching or latch
        if not self._stop.is_set():
            self._stop_reason = reason
            self._stop.set()

    def leave(self) -> None:
        """Interrupt the test as a crash would and return at once: the recording stays open for a resume."""
        self._leaving = True
        self.stop("the sequencer was told to end", latch=False)

    def hold(self, reason: str) -> None:
        """Hold the test after the current repeat; return at once."""
        self._holds.ask(reason)

    def resume(self, call: Call) -> None:
        """Continue after a hold by a person or a fault; raises FaultError if the rig cannot play."""
        self._require_rig()
        self._holds.resume(call)

    def decide(self, decision: sequencer_pb2.EnduranceDecision, call: Call) -> None:
        """Apply a person's decision on a hold; return when it is stored."""
        if decision.kind != sequencer_pb2.ENDURANCE_DECISION_KIND_END and self._holds.open is not None:
            self._require_rig()
        self._holds.decide(decision, call)

    def _require_rig(self) -> None:
        description = described_rig(self._bus, self.rig)
        if description.content_hash != self._plan.description.content_hash:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"The rig {self.rig!r} is not the one that the endurance test was started on: it was changed since; "
                "put it back, or start another test.",
                field="rig",
            )

    def _run(self) -> None:
        fault = FaultError(query_pb2.FAULT_CODE_INTERNAL, "The test ended by a defect of the sequencer; see its log.")
        final = self._final_fault(fault)
        try:
            final = self._ended()
            if self._latching and not self._latched:
                self._halt(final)
        except Exception:  # noqa: BLE001 - whatever it is, the test must not stay open forever
            self._journal.exception("The endurance test could not be brought to its end.", step=self._step)
        finally:
            self._journal.info("endurance test ended", how=final.activity)
            self._on_end()
            self._board.end(final)

    def _ended(self) -> sequencer_pb2.EnduranceStatus:
        """Play all repeats, and return the final status once the recording is closed."""
        try:
            self._sequence()
        except _EndedByAlarmError as alarm:
            self.stop(str(alarm))
            return self._broken_off(FaultError(query_pb2.FAULT_CODE_CANCELLED, str(alarm)))
        except FaultError as fault:
            return self._broken_off(fault)
        except Exception as error:  # noqa: BLE001 - the rig has to be brought to rest whatever went wrong
            self._journal.exception("The endurance test failed by a defect.", step=self._step)
            defect = f"A defect of the sequencer ({type(error).__name__}: {error}); its log says more."
            return self._broken_off(FaultError(query_pb2.FAULT_CODE_INTERNAL, defect))
        unknown = sum(tally.unknown for tally in self._tallies)
        unknown_ends = f", of which the end of {unknown} is not known" if unknown else ""
        final = self._board.final_status(
            sequencer_pb2.ENDURANCE_PHASE_FINISHED, f"finished after {len(self._plan.sequence)} repeats{unknown_ends}"
        )
        self._log.close(final, reason=final.activity)
        self._kept.close()
        return final

    def _sequence(self) -> None:
        """Do all remaining steps."""
        self._begin()
        if self._before.hold is not None:
            self._apply(self._before.hold, self._holds.wait(self._before.hold, stored=True))
        if (broken_off := self._before.iterating) is not None:
            self._wait(f"Iterating again was broken off. {self._passed_unwatched}".rstrip(), alarms=broken_off.alarms)
        total, next_repeat = len(self._plan.sequence), self._before.next_repeat
        while next_repeat < total:
            if self._holds.asked:
                self._wait(f"A person asked it to wait: {self._holds.asked}")
            self._require_running()
            if next_repeat - self._first_repeat >= self._repeats_per_volume:
                self._begin_volume(next_repeat)
            if self._repeat(next_repeat):
                next_repeat, self._attempt = next_repeat + 1, 1

    def _begin(self) -> None:
        """Store the steps of the recording before the next repeat."""
        before = self._before
        self._require_running()
        self._step = "storing what the test is"
        self._board.change(self._show_step)
        owed = self._kept.restore(next_repeat=before.next_repeat, stored=before.samples)
        if before.volume_ended:
            self._begin_volume(before.next_repeat, ended=True)
        else:
            spec = (self._plan.spec,) if before.volume == 1 else ()
            beginning = (*spec, self._volume(self._first_repeat), self._plan.description)
            for message in beginning[self._log.next_step :]:
                self._log.commit(message)
        if before.announced:
            self._count_unknown(
                before.next_repeat, before.announced, "the sequencer or its connection ended while it played"
            )
            before.announced = ""
        if before.correcting is not None:
            self._step = f"counting the playbacks of campaign {before.correcting.campaign}"
            self._passed_unwatched = self._corrections.count(before.correcting, on_activity=self._show_correction)
            before.correcting = None
        self._commit_held(owed, "around an alarm before the sequencer ended")
        self._board.change(self._show_counts)

    def _begin_volume(self, repeat: int, *, ended: bool = False) -> None:
        """Continue in the next recording."""
        if ended:
            self._log.next_volume()
        else:
            self._log.begin_volume()
        self._first_repeat = repeat
        self._log.commit(self._volume(repeat))
        self._log.commit(self._plan.description)

    def _volume(self, repeat: int) -> sequencer_pb2.EnduranceVolume:
        names = self._plan.names
        return sequencer_pb2.EnduranceVolume(
            id=self.id,
            rig=self.rig,
            number=self._log.volume,
            first_repeat=repeat,
            columns=column_names(self._plan.schedule.monitoring),
            events=progress_of_events(names, self._tallies),
            monitor=self._monitor.state(),
            baselines=[self._monitor.baseline(name) for name in names],
            alarms=self._alarms,
            kept=self._board.snapshot().kept,
            kept_before=self._kept.kept_before,
            drives=self._corrections.in_use,
            holds=self._holds.last,
        )

    def _repeat(self, repeat: int) -> bool:
        """Play, judge and commit one repeat; return False if the rig did not move and the test waited."""
        event = int(self._plan.sequence[repeat])
        tally, name = self._tallies[event], self._plan.names[event]
        if refusal := self._rig.refusal():
            self._wait(refusal)
            return False
        kept = self._kept.keeps(repeat, tally.played)
        run = run_name(self.id, repeat, attempt=self._attempt)
        total = len(self._plan.sequence)
        self._step = f"playing repeat {repeat} ({repeat + 1} of {total}), {name}, on {self.rig}"
        self._board.change(self._show_step)
        begun = time.monotonic()
        self._log.commit(
            recorder_pb2.RunPlanned(run=run, rig=self.rig, purpose=f"repeat {repeat} of {name}", not_kept=not kept)
        )
        self._moving_run = run
        try:
            played, response = self._rig.play(self._corrections.drives[event], run=run, repeat=repeat)
        except FaultError as fault:
            if fault.code in REFUSALS and not self._stop.is_set():
                self._moving_run = ""
                self._attempt += 1
                self._wait(f"The rig refused repeat {repeat}: {fault.message}")
                return False
            self._break_off(repeat, run, fault)
            return True
        self._moving_run = ""
        self._commit_played(repeat, event, played, response, kept=kept, begun=begun)
        return True

    def _commit_played(
        self,
        repeat: int,
        event: int,
        played: rig_pb2.PlayResult,
        response: NDArray[np.float64],
        *,
        kept: bool,
        begun: float,
    ) -> None:
        """Judge a repeat, commit it, and perform the actions of its alarms; `begun`: Monotonic time of its start."""
        tally, name = self._tallies[event], self._plan.names[event]
        verdict = self._monitor.judge(repeat, name, response=response)
        damage = verdict.statistics.table[:, _DAMAGE]
        tally.count_measured(damage)
        self._alarms += len(verdict.alarms)
        found = time.time_ns()
        step = sequencer_pb2.EnduranceRepeat(
            repeat=repeat,
            event=event,
            drive=tally.drive,
            run=played.run,
            end=sequencer_pb2.REPEAT_END_PLAYED,
            damage=to_array(damage),
            alarms=[
                alarm_message(alarm, event=event, action=self._action(alarm.level), found=found)
                for alarm in verdict.alarms
            ],
            baseline=self._monitor.baseline(name) if verdict.baseline_changed else b"",
            warnings=played.warnings,
        )
        put_statistics(verdict.statistics, step)
        held = self._last = HeldRepeat(repeat, event, tally.drive, played.run, response)
        if not kept:
            self._kept.hold(held)
            self._log.commit(step)
        else:
            self._commit_kept(step, held, played)
        self._pace(time.monotonic() - begun)
        self._board.show_repeat(step, kept=kept, counts=self._show_counts)
        self._step = _BETWEEN
        if step.alarms:
            self._after_alarms(step, verdict)

    def _commit_kept(self, step: sequencer_pb2.EnduranceRepeat, held: HeldRepeat, played: rig_pb2.PlayResult) -> None:
        """Commit a repeat with its signal blocks, or with its samples if the recorder lacks some."""
        step.signal_epoch, step.signal_blocks = played.epoch, played.blocks
        step.samples_hash = samples_hash(self._corrections.drives[held.event], held.response)
        try:
            self._log.commit(step)
        except FaultError as fault:
            if (fault.code, fault.field) != SAMPLES_LACK:
                raise
            self._journal.warning("A repeat is stored with its samples.", run=held.run, why=fault.message)
            step.signal_epoch, step.signal_blocks, step.samples_hash = 0, 0, ""
            self._log.commit(step)
            self._log.commit(self._samples(held, "signal blocks of the run are missing"))
            return
        self._log.commit(recorder_pb2.RunPlayed(run=played.run, rig=self.rig, epoch=played.epoch, blocks=played.blocks))

    def _commit_held(self, held: Sequence[HeldRepeat], reason: str) -> None:
        for each in held:
            self._log.commit(self._samples(each, reason))
            self._kept.forget(each)
        if held:
            self._board.change(lambda status: setattr(status, "kept", status.kept + len(held)))

    def _samples(self, held: HeldRepeat, reason: str) -> sequencer_pb2.RepeatSamples:
        description = self._plan.description
        return sequencer_pb2.RepeatSamples(
            repeat=held.repeat,
            event=held.event,
            drive=held.drive,
            run=held.run,
            response=to_record(description.responses, description.sample_rate, held.response),
            reason=reason,
        )

    def _action(self, level: AlarmLevel) -> AlarmAction:
        actions = self._plan.schedule.actions
        return actions.abort if level is AlarmLevel.ABORT else actions.warning

    def _after_alarms(self, step: sequencer_pb2.EnduranceRepeat, verdict: RepeatVerdict) -> None:
        """Keep the samples around an alarm, and perform the most cautious of the actions."""
        for alarm in step.alarms:
            self._journal.warning("alarm", repeat=step.repeat, what=alarm.sentence)
        self._commit_held(self._kept.after_alarm(step.repeat), f"around the alarm of repeat {step.repeat}")
        actions = {self._action(alarm.level) for alarm in verdict.alarms}
        sentence = step.alarms[0].sentence
        if AlarmAction.STOP in actions:
            raise _EndedByAlarmError(sentence)
        if AlarmAction.HOLD in actions:
            self._wait(sentence, alarms=step.alarms)
        elif AlarmAction.ITERATE_AGAIN in actions:
            alarm, reason = self._corrections.reason_against(step.event, verdict.alarms[0])
            if reason:
                self._board.add_remark(reason)
                # Without any repeat left, a decision would change nothing.
                if step.repeat + 1 < len(self._plan.sequence):
                    self._wait(f"{alarm.sentence} {reason} Continue, relearn or end.", alarms=step.alarms)
                return
            self._require_running()
            hold = sequencer_pb2.EnduranceHold(next_repeat=step.repeat + 1, reason=sentence, alarms=step.alarms)
            self._apply(hold, self._holds.decided(hold, sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN))

    def _break_off(self, repeat: int, run: str, fault: FaultError) -> None:
        """Count a repeat with an unknown end, bring the rig to rest, and wait for a person."""
        self._journal.warning("A repeat was broken off.", run=run, why=fault.message)
        if self._stop.is_set():
            self._count_unknown(repeat, run, f"it was stopped: {self._stop_reason}")
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        trouble = bring_to_rest(self._bus, self.rig, run=run, reason=fault.message)
        self._moving_run = ""
        self._count_unknown(repeat, run, fault.message)
        self._wait(
            f"Repeat {repeat} was broken off and counts as played, its damage as planned: {fault.message}"
            + (f" {trouble[0].upper()}{trouble[1:]}." if trouble else "")
        )

    def _count_unknown(self, repeat: int, run: str, why: str) -> None:
        """Commit an announced repeat with an unknown end: never played again, its damage as planned."""
        event = int(self._plan.sequence[repeat])
        tally = self._tallies[event]
        damage = tally.count_unknown()
        counted = "its damage as planned" if tally.planned_damage is not None else "its damage as the mean so far"
        reason = (
            f"Repeat {repeat} ({self._plan.names[event]}) counts as played, "
            f"{counted if damage is not None else 'no damage is known of it'}: {why.rstrip('.')}."
        )
        self._log.commit(
            sequencer_pb2.EnduranceRepeat(
                repeat=repeat,
                event=event,
                drive=tally.drive,
                run=run,
                end=sequencer_pb2.REPEAT_END_UNKNOWN,
                reason=reason,
                damage=None if damage is None else to_array(damage),
            )
        )
        self._board.change(self._show_counts)
        self._board.add_remark(reason)

    def _wait(self, reason: str, *, alarms: Sequence[sequencer_pb2.EnduranceAlarm] = ()) -> None:
        """Wait before the next repeat, and apply the decision."""
        next_repeat = sum(tally.played for tally in self._tallies)
        hold = sequencer_pb2.EnduranceHold(next_repeat=next_repeat, reason=reason, alarms=alarms)
        self._last = None
        self._apply(hold, self._holds.wait(hold))

    def _apply(self, hold: sequencer_pb2.EnduranceHold, decision: sequencer_pb2.EnduranceDecision) -> None:
        by = f" by {decision.name}: {decision.reason}" if decision.name else ""
        if decision.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_END:
            self.stop(f"ended at a hold{by}", latch=False)
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"Ended at a hold{by}.")
        if decision.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_RELEARN:
            self._monitor.relearn()
        if decision.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN:
            self._iterate_again(hold)

    def _iterate_again(self, hold: sequencer_pb2.EnduranceHold) -> None:
        """Correct the drives of the events with alarms, or of the next repeat's event; hold again if that fails."""
        events = {alarm.event for alarm in hold.alarms}
        if not events:
            # After the last repeat there is no event, and no drive to correct.
            events = {int(event) for event in self._plan.sequence[hold.next_repeat : hold.next_repeat + 1]}
        for event in sorted(events):
            if no_repeat_left := self._corrections.no_repeat_left(event):
                self._board.add_remark(no_repeat_left)
                continue
            name = self._plan.names[event]
            self._step = f"iterating again for {name}"
            last = self._last if self._last is not None and self._last.event == event else None
            try:
                drive = self._corrections.correct(
                    event, response=None if last is None else last.response, on_activity=self._show_correction
                )
            except FaultError as fault:
                self._require_running()
                failed = f"The drive of {name} was not corrected: {fault.message}"
                self._board.add_remark(failed)
                self._wait(failed, alarms=hold.alarms)
                return
            self._monitor.relearn(name)
            self._board.change(self._show_counts)
            self._board.add_remark(f"{name} has drive {drive.number} of campaign {drive.campaign}.")

    def _show_correction(self, activity: str) -> None:
        def change(status: sequencer_pb2.EnduranceStatus) -> None:
            status.phase = sequencer_pb2.ENDURANCE_PHASE_ITERATING
            status.activity = f"{self._step}: {activity}"

        self._board.change(change)

    def _show_counted(self, correction: sequencer_pb2.EnduranceCorrection) -> None:
        self._board.change(self._show_counts)
        if correction.playbacks or not correction.HasField("damage"):
            self._board.add_remark(correction.reason)

    def _show_counts(self, status: sequencer_pb2.EnduranceStatus) -> None:
        """Show what is counted; called as soon as it is stored, so that status and recording agree."""
        status.played = sum(tally.played for tally in self._tallies)
        status.unknown = sum(tally.unknown for tally in self._tallies)
        left = len(self._plan.sequence) - status.played
        status.remaining_seconds = left * self._repeat_seconds if self._repeat_seconds else -1.0
        del status.events[:]
        status.events.extend(progress_of_events(self._plan.names, self._tallies))
        put_damage(self._tallies, into=status)
        status.recordings, status.recording = self._log.volume, self._log.recording

    def _pace(self, seconds: float) -> None:
        share = _PACE_SHARE if self._repeat_seconds else 1.0
        self._repeat_seconds += share * (seconds - self._repeat_seconds)

    def _require_running(self) -> None:
        if self._stop.is_set():
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")

    def _show_step(self, status: sequencer_pb2.EnduranceStatus) -> None:
        status.phase, status.activity = sequencer_pb2.ENDURANCE_PHASE_PLAYING, self._step

    def _show_hold(self, hold: sequencer_pb2.EnduranceHold | None) -> None:
        """Show the hold that the test waits with, or that it continues."""

        def change(status: sequencer_pb2.EnduranceStatus) -> None:
            status.ClearField("hold")
            if hold is None:
                status.phase, status.activity = sequencer_pb2.ENDURANCE_PHASE_PLAYING, "going on"
            else:
                status.phase, status.activity = sequencer_pb2.ENDURANCE_PHASE_HOLDING, f"waiting: {hold.reason}"
                status.hold.CopyFrom(hold)

        self._step = "going on"
        if hold is not None:
            is_last = hold.next_repeat >= len(self._plan.sequence)
            self._step = "waiting after the last repeat" if is_last else f"waiting before repeat {hold.next_repeat}"
            self._journal.info("The endurance test waits.", hold=hold.number, why=hold.reason)
        self._board.change(change)

    def _show_waiting(self, why: str) -> None:
        """Show that the test pauses because its next step cannot be stored yet."""
        if why and not self._board.snapshot().activity.startswith(_PAUSED):
            self._journal.warning("The endurance test waits for its recorder.", step=self._step, why=why)
        activity = f"{_PAUSED} while {self._step}: {why}" if why else self._step
        self._board.change(lambda status: setattr(status, "activity", activity))

    def _broken_off(self, fault: FaultError) -> sequencer_pb2.EnduranceStatus:
        """Bring the rig to rest, close the recording if the test ended, and return the final status with the fault."""
        final = self._final_fault(fault)
        self._halt(final)
        ended = self._stop.is_set() and not self._leaving
        if ended and self._log.next_step:
            try:
                self._log.close(final, reason=final.fault.message)
                self._kept.close()
            except FaultError as error:
                self._journal.warning("The recording stays open.", why=error.message)
        return final

    def _halt(self, final: sequencer_pb2.EnduranceStatus) -> None:
        """Bring the rig to rest, and latch it if the test was stopped."""
        self._latched = self._latching
        halt_rig(self._bus, self.rig, final, run=self._moving_run, reason=self._stop_reason, latch=self._latching)

    def _final_fault(self, fault: FaultError) -> sequencer_pb2.EnduranceStatus:
        """Return the final status of a test that was stopped or failed."""
        stopped = self._stop_reason if self._stop.is_set() else None
        end = early_end(
            fault,
            what="endurance test",
            step=self._step,
            service=self._bus.service,
            stopped=stopped,
            remedy="Resume it: it goes on.",
        )
        failed, was_stopped = sequencer_pb2.ENDURANCE_PHASE_FAULTED, sequencer_pb2.ENDURANCE_PHASE_STOPPED
        phase = failed if stopped is None else was_stopped
        return self._board.final_status(phase, end.activity, fault=end.fault)
