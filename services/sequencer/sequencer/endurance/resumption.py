"""Start of an endurance test: new, or from its recordings."""

from __future__ import annotations

import numpy as np
from google.protobuf.message import Message

from duralab_bus import Bus, FaultError, RecordingLog
from duralab_monitoring import Monitor
from duralab_proto.arrays import from_array
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from sequencer.endurance.endurance_test import Progress
from sequencer.endurance.messages import restored_tally, stored_statistics
from sequencer.endurance.plan import EndurancePlan
from sequencer.endurance.recorded import RecordedTest
from sequencer.endurance.test_log import volume_name


def fresh_progress(plan: EndurancePlan) -> Progress:
    """Return the progress of a test without any repeat."""
    return Progress(tallies=plan.fresh_tallies(), monitor=plan.fresh_monitor())


def require_open(bus: Bus, recorded: RecordedTest) -> None:
    """Refuse a test that has ended; close its recording first if a crash prevented that."""
    if (final := recorded.last.final) is not None:
        if not recorded.last.closed:
            log = RecordingLog(bus, volume_name(recorded.spec.id, recorded.last.number), next_step=recorded.last.steps)
            log.commit(recorder_pb2.RecordingClosed(reason=final.fault.message or final.activity))
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Endurance test {recorded.spec.id!r} has ended ({final.activity}); start a new one.",
            field="id",
        )


def require_same_rig(recorded: RecordedTest, description: rig_pb2.RigDescription) -> None:
    """Refuse a rig that was changed since the test began."""
    before = recorded.last.description
    if before is not None and before.content_hash != description.content_hash:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The rig {description.rig!r} is not the one that the endurance test was started on: it was changed since; "
            "put it back, or start another test.",
            field="rig",
        )


def go_on_recording(bus: Bus, recorded: RecordedTest) -> None:
    """Check that the recorder can continue the last recording."""
    last = recorded.last
    if last.closed or last.last is None:
        return
    name = volume_name(recorded.spec.id, last.number)
    RecordingLog(bus, name, next_step=last.steps).confirm(last.last)


def recorded_progress(recorded: RecordedTest, plan: EndurancePlan) -> Progress:
    """Return the state for the next repeat, from the last recording."""
    last = recorded.last
    if last.volume is None:
        fresh = fresh_progress(plan)
        fresh.next_step = last.steps
        return fresh
    size = len(plan.description.responses)
    tallies = [
        restored_tally(event, planned, responses=size)
        for event, planned in zip(last.volume.events, plan.planned_damage, strict=True)
    ]
    monitor = plan.restored_monitor(last.volume.monitor, last.volume.baselines)
    for repeat in last.repeats:
        if repeat.end == sequencer_pb2.REPEAT_END_PLAYED:
            damage = from_array(repeat.damage, field="damage", shape=(size,), dtype=np.float64)
            tallies[repeat.event].count_measured(damage)
        else:
            tallies[repeat.event].count_unknown()
    for correction in last.corrections:
        counted = correction.HasField("damage")
        damage = from_array(correction.damage, field="damage", shape=(size,), dtype=np.float64) if counted else None
        tallies[correction.event].count_correction(correction.playbacks, damage)
    for change in last.changes:
        _monitor_again(monitor, change, plan, responses=size)
    kept_before = last.volume.kept_before
    for repeat in last.repeats:
        if repeat.alarms:
            kept_before = max(kept_before, repeat.repeat + plan.schedule.keep.around_alarm + 1)
    drives = {drive.event: drive for drive in (*last.volume.drives, *last.drives)}
    for drive in drives.values():
        tallies[drive.event].drive = drive.number
    return Progress(
        tallies=tallies,
        monitor=monitor,
        volume=last.number,
        first_repeat=last.volume.first_repeat,
        next_step=last.steps,
        alarms=last.volume.alarms + sum(len(repeat.alarms) for repeat in last.repeats),
        kept_before=kept_before,
        holds=last.holds,
        drives=list(drives.values()),
        announced=last.announced.run if last.announced is not None else "",
        # A hold by a fault or a person ends with the resume.
        hold=last.hold if last.hold is not None and last.hold.alarms else None,
        iterating=last.iterating,
        correcting=last.correcting,
        volume_ended=last.closed,
        samples=last.samples,
        kept=last.volume.kept + len(last.samples) + sum(bool(repeat.samples_hash) for repeat in last.repeats),
    )


def _monitor_again(monitor: Monitor, change: Message, plan: EndurancePlan, *, responses: int) -> None:
    """Update the monitor by a recorded step, as the step did during the test."""
    match change:
        case sequencer_pb2.EnduranceRepeat() if change.end == sequencer_pb2.REPEAT_END_PLAYED:
            statistics = stored_statistics(change, responses=responses)
            monitor.replay(change.repeat, plan.names[change.event], statistics, baseline=change.baseline)
        case sequencer_pb2.EnduranceDecision() if change.kind == sequencer_pb2.ENDURANCE_DECISION_KIND_RELEARN:
            monitor.relearn()
        case sequencer_pb2.EnduranceDrive():
            monitor.relearn(plan.names[change.event])
