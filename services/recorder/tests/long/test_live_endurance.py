"""The live view of an endurance test: a point for every repeat and every alarm, and the same made from the log."""

from __future__ import annotations

import re

import numpy as np
import pytest
from printed_view import rows_of, run_rerun

from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from recorder import rebuild_view
from recorder.live import LiveView
from recorder.log import Archive
from recorder.refused import RefusedError

EVENTS = ("rough", "smooth")
CHANNELS = ("left_vertical", "right_vertical")
COLUMNS = ("min", "max", "mean", "rms", "std", "damage", "residual static", "residual 0.5 to 2 Hz")
REPEATS, ALARMED, UNKNOWN = 60, 40, 25


def steps(first=0, known_before=0):
    """Yield the steps of a recording; the residual of the first channel grows from one repeat on."""
    if first == 0:
        spec = sequencer_pb2.EnduranceSpec(id="weeks", rig="front_axle")
        for name in EVENTS:
            spec.events.add(name=name, planned_damage=to_array(np.array([2.0, 4.0])))
        yield spec
    volume = sequencer_pb2.EnduranceVolume(
        id="weeks", rig="front_axle", number=1 + bool(first), first_repeat=first, columns=COLUMNS
    )
    for name in EVENTS:
        volume.events.add(
            name=name,
            planned=30,
            measured=known_before,
            damage=to_array(np.full(2, 1.0 * known_before)),
            measured_damage=to_array(np.full(2, 1.0 * known_before)),
        )
    yield volume
    responses = [array_pb2.Channel(name=name, unit="N") for name in CHANNELS]
    drives = [array_pb2.Channel(name=name, unit="m") for name in CHANNELS]
    yield rig_pb2.RigDescription(
        rig="front_axle",
        sample_rate=100.0,
        drives=drives,
        responses=responses,
        static_response=to_array(np.zeros(2)),
    )
    for repeat in range(first, REPEATS):
        event = repeat % 2
        step = sequencer_pb2.EnduranceRepeat(
            repeat=repeat, event=event, run=f"weeks.r{repeat:07d}", damage=to_array(np.array([1.0, 2.0]))
        )
        if repeat != UNKNOWN:
            change = 0.1 if repeat >= ALARMED else 0.0
            table = [[-900 - event, 800, 1, 300 + repeat, 300, 1.0, 0.01, 0.02 + change], [0] * 8]
            step.statistics.CopyFrom(to_array(np.array(table, dtype=np.float64)))
        if repeat == ALARMED:
            step.alarms.add(
                repeat=repeat,
                event=event,
                level=sequencer_pb2.ALARM_LEVEL_ABORT,
                channel=CHANNELS[0],
                sentence="left_vertical, 0.5 to 2 Hz: sudden change of +10 % of the channel's RMS.",
            )
        yield step
    yield sequencer_pb2.EnduranceHold(number=1, next_repeat=ALARMED + 1, reason="An alarm waits for a person.")


@pytest.fixture
def live_file(tmp_path):
    view = LiveView("weeks", file=tmp_path / "live.rrd", viewer=None)
    for step in steps():
        view.show_step(step)
        # As a view does that begins while its recording is written.
        view.show_step(step)
    assert view.close()
    return tmp_path / "live.rrd"


@pytest.fixture
def rebuilt_file(tmp_path, step_of):
    archive = Archive(tmp_path, least_free_bytes=0)
    for number, message in enumerate(steps()):
        archive.commit("weeks", step_of(number, message))
    archive.commit("weeks", step_of(number + 1, recorder_pb2.RecordingClosed(reason="done")))
    assert rebuild_view.main([str(tmp_path / "weeks.mcap"), "--out", str(tmp_path / "again.rrd")]) == 0
    return tmp_path / "again.rrd"


def curve(trend, channel, name):
    return f"/trend/{trend}/{channel}/{name}"


@pytest.mark.parametrize("file", ["live_file", "rebuilt_file"])
def test_every_repeat_is_a_point_and_every_alarm_too(file, request, rerun_program, viewer_environment):
    path = request.getfixturevalue(file)

    def rows(entity):
        return rows_of(rerun_program, viewer_environment, entity, path)

    # Beside the points a row for the look of a curve; the repeat whose end is not known is of the second event.
    for trend in ("rms", "min", "max", "residual"):
        assert rows(curve(trend, "left_vertical", "rough")) == 30 + 1
        assert rows(curve(trend, "left_vertical", "smooth")) == 29 + 1
        assert rows(curve(trend, "left_vertical", "alarms")) == 1 + 1
        assert rows(curve(trend, "right_vertical", "alarms")) == 0 + 1
    assert rows("/damage/left_vertical") == 60 + 1


def test_alarm_and_hold_are_told(live_file, rerun_program, viewer_environment):
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", "-vvv", live_file)
    assert re.search(r"Repeat 40, \*\*abort\*\*: left_vertical, 0\.5 to 2 Hz", printed)
    assert "Waits before repeat 41" in printed
    assert "60 of 60 repeats" in printed


def test_a_later_recording_goes_on_with_the_damage_of_those_before(tmp_path, rerun_program, viewer_environment):
    file = tmp_path / "later.rrd"
    view = LiveView("weeks-v0002", file=file, viewer=None)
    for step in steps(first=50, known_before=25):
        view.show_step(step)
    assert view.close()
    # 25 repeats of each event did 1 each: the first of ten more, of 60 in all, makes 51 of 60.
    printed = run_rerun(
        rerun_program, viewer_environment, "rrd", "print", "-vvv", "--entity", "/damage/left_vertical", file
    )
    assert "85.0" in printed
    assert rows_of(rerun_program, viewer_environment, "/damage/left_vertical", file) == 10 + 1


def test_the_damage_of_a_correction_counts_from_the_next_repeat_on(tmp_path, rerun_program, viewer_environment):
    file = tmp_path / "corrected.rrd"
    view = LiveView("weeks-v0002", file=file, viewer=None)
    correction = sequencer_pb2.EnduranceCorrection(
        event=1, campaign="weeks-smooth-1", playbacks=2, damage=to_array(np.array([6.0, 0.0])), next_repeat=50
    )
    for place, step in enumerate(steps(first=50, known_before=25)):
        view.show_step(step)
        if place == 1:
            # Twice, as a view gets it that begins while its recording is written.
            view.show_step(correction)
            view.show_step(correction)
    assert view.close()
    # 51 of 60 and the 6 of the correction, then 60 and 6.
    printed = run_rerun(
        rerun_program, viewer_environment, "rrd", "print", "-vvv", "--entity", "/damage/left_vertical", file
    )
    assert "[95.0]" in printed
    assert "[110.0]" in printed


def test_a_correction_is_a_step_that_the_recorder_accepts(step_of):
    correction = sequencer_pb2.EnduranceCorrection(campaign="a", damage=to_array(np.zeros((2, 2))))
    step_of(0, sequencer_pb2.CorrectionPlanned(campaign="a"))
    with pytest.raises(RefusedError, match="damage"):
        step_of(1, correction)
    correction.damage.CopyFrom(to_array(np.zeros(2)))
    step_of(1, correction)
