"""What rig, recorder and sequencer remember of repeats stops growing at its bound, counted in bytes of Python."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import numpy as np

from duralab_bus.spool.spool import Spool, SpoolSpace
from duralab_bus.streams.publisher import SPOOL_BYTES
from duralab_gateway.interlock import REMEMBERED_RUNS, Interlock
from duralab_proto.v1 import recorder_pb2, sequencer_pb2
from duralab_schedules import KeepRule
from recorder.log.archive import REMEMBERED, RecentlyClosed, RunRegistry
from recorder.log.recording import StepOrder
from sequencer.endurance.status_board import MOST_SHOWN, EnduranceBoard
from sequencer.kept_samples import HeldRepeat, KeptSamples
from sequencer.service import _EVENT_BYTES

# What is remembered of a repeat takes 50 bytes and more.
_BYTES_A_REPEAT = 8


def grown_bytes(repeat: Callable[[int], object], *, bound: int, more: int) -> int:
    """Return the bytes that `more` repeats take once `bound` of them, and a tenth, are over."""
    first = bound + bound // 10 + 1
    gc.collect()
    tracemalloc.start()
    try:
        for number in range(first):
            repeat(number)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        for number in range(first, first + more):
            repeat(number)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def test_a_container_that_grows_is_found():
    kept: list[str] = []
    assert grown_bytes(lambda number: kept.append(f"run-{number}"), bound=100, more=1000) > 1000 * _BYTES_A_REPEAT


def test_the_rig_forgets_all_but_the_last_names_of_runs_and_resets():
    interlock = Interlock("axle")

    def repeat(number: int) -> None:
        interlock.begin(f"weeks-{number:09d}")
        interlock.end()
        interlock.claim(f"reset-{number:09d}")

    assert (
        grown_bytes(repeat, bound=REMEMBERED_RUNS, more=REMEMBERED_RUNS // 4) < REMEMBERED_RUNS // 4 * _BYTES_A_REPEAT
    )


def test_the_recorder_forgets_all_but_the_steps_of_the_recordings_that_closed_last(tmp_path):
    closed, steps = RecentlyClosed(tmp_path), 200

    def close(number: int) -> None:
        order = StepOrder(f"weeks-v{number:04d}")
        order.restore(["duralab.v1.EnduranceRepeat"] * steps, [f"{number:032x}{step:032x}" for step in range(steps)])
        closed.remember(f"weeks-v{number:04d}", order)

    assert grown_bytes(close, bound=REMEMBERED, more=3 * REMEMBERED) < 3 * REMEMBERED * steps * _BYTES_A_REPEAT
    assert closed.find(f"weeks-v{REMEMBERED:04d}") is None


def test_the_recorder_forgets_the_runs_of_a_recording_that_closed_and_those_that_are_not_kept():
    runs = RunRegistry()

    def record(number: int) -> None:
        name = f"weeks-v{number:04d}"
        for repeat in range(20):
            runs.note(recorder_pb2.RunPlanned(run=f"{name}-{repeat}", rig="axle"), name)
            runs.note(recorder_pb2.RunPlanned(run=f"{name}-x{repeat}", rig="axle", not_kept=True), name)
        runs.forget(name)

    assert grown_bytes(record, bound=20, more=200) < 200 * 40 * _BYTES_A_REPEAT


def test_the_sequencer_keeps_the_last_events_of_a_test():
    space = SpoolSpace(_EVENT_BYTES)
    spool = Spool(space.store(key="event", epoch=1), held=False, unheld_bytes=min(SPOOL_BYTES, _EVENT_BYTES // 8))
    bound = _EVENT_BYTES // 8 // 2000
    grown = grown_bytes(lambda number: spool.append(number.to_bytes(2000, "little"), ""), bound=bound, more=3 * bound)
    assert grown < 3 * bound * _BYTES_A_REPEAT
    assert space.used_bytes <= _EVENT_BYTES // 8


def test_the_sequencer_holds_as_many_samples_as_an_alarm_asks_for():
    kept = KeptSamples(KeepRule(first=0, around_alarm=3))

    def repeat(number: int) -> None:
        kept.hold(HeldRepeat(number, 0, 0, f"weeks-{number}", np.zeros((2, 500))))

    assert grown_bytes(repeat, bound=4, more=400) < 400 * _BYTES_A_REPEAT


def test_a_status_shows_the_last_remarks_and_alarms_only():
    board = EnduranceBoard(sequencer_pb2.EnduranceStatus(id="weeks"), publish=lambda status: None)

    def repeat(number: int) -> None:
        alarm = sequencer_pb2.EnduranceAlarm(repeat=number, sentence=f"alarm {number}")
        board.add_remark(f"remark {number}")
        step = sequencer_pb2.EnduranceRepeat(repeat=number, alarms=[alarm])
        board.show_repeat(step, kept=False, counts=lambda status: setattr(status, "played", number))

    for number in range(3 * MOST_SHOWN):
        repeat(number)
    # Protobuf's memory is not Python's: its size is that of what it holds.
    size = board.snapshot().ByteSize()
    for number in range(3 * MOST_SHOWN, 9 * MOST_SHOWN):
        repeat(number)
    status = board.snapshot()
    assert (len(status.remarks), len(status.last_alarms)) == (MOST_SHOWN, MOST_SHOWN)
    assert status.ByteSize() <= size + 10 * MOST_SHOWN
