"""Which alarms of an endurance test start a correction of the drive, and which hold the test."""

import numpy as np
import pytest

from duralab_proto.v1 import sequencer_pb2
from sequencer.endurance import drive_corrections

from .one_rig_lab import DRIVE, OneRigLab, campaign, decide, holding_or_ended, messages, wait_for

AGAIN = (
    "actions: {warning: iterate_again, abort: iterate_again}\nmonitoring: {baseline_repeats: 6, bands: [2, 8, 40]}\n"
)


@pytest.fixture
def corrections(monkeypatch):
    """Return the list of the campaigns that corrected a drive; each makes the same drive again."""
    made = []

    def correct(*_, id, **__):
        made.append(id)
        return DRIVE

    monkeypatch.setattr(drive_corrections, "corrected_drive", correct)
    return made


def from_repeat(first, channel, *, gain=1.0, shift=0.0):
    def change(repeat, response):
        if repeat >= first:
            response[channel] = gain * response[channel] + shift
        return response

    return change


def test_an_alarm_in_a_controlled_channel_and_in_the_band_corrects_the_drive(corrections):
    lab = OneRigLab(change=from_repeat(12, 0, gain=1.5), made_by=campaign(weights=[1.0, 0.0]))
    _, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED, status
    assert corrections == ["weeks-road_0-1"]


@pytest.mark.parametrize(
    ("change", "made_by", "sentence"),
    [
        (
            from_repeat(12, 1, gain=1.5),
            campaign(weights=[1.0, 0.0]),
            "No drive of road_0 corrects this alarm: body is not controlled, its weight is 0. Continue, relearn",
        ),
        (
            from_repeat(12, 0, shift=5.0),
            campaign(),
            "corrects this alarm: the static part of force is outside the control band of 1 to 25 Hz. Continue",
        ),
        (
            from_repeat(12, 0, gain=1.5),
            campaign(lowest_frequency=9.0),
            "corrects this alarm: force at 2 to 8 Hz is outside the control band of 9 to 25 Hz. Continue",
        ),
    ],
)
def test_an_alarm_that_no_drive_corrects_holds_the_test(corrections, change, made_by, sentence):
    settings = (
        AGAIN.replace("bands:", "learnt_limits: {warning: 10, abort: 10}, bands:") if "at 2" in sentence else AGAIN
    )
    test, board = OneRigLab(change=change, made_by=made_by).test(repeats=20, more=settings)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING, status
    assert sentence in status.hold.reason
    assert status.hold.alarms
    assert corrections == []
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def both_from_repeat(first, *, body, body_first=None):
    def change(repeat, response):
        response[0] *= 1.5 if repeat >= first else 1.0
        response[1] *= body if repeat >= (body_first or first) else 1.0
        return response

    return change


@pytest.mark.parametrize(
    ("body", "actions", "of_body"),
    [
        (1.5, "{warning: iterate_again, abort: iterate_again}", sequencer_pb2.ALARM_ACTION_ITERATE_AGAIN),
        (1.05, "{warning: log, abort: iterate_again}", sequencer_pb2.ALARM_ACTION_LOG),
    ],
)
def test_an_alarm_that_no_drive_corrects_is_not_learned_away_with_one_that_a_drive_corrects(
    corrections, body, actions, of_body
):
    lab = OneRigLab(change=both_from_repeat(12, body=body), made_by=campaign(weights=[1.0, 0.0]))
    settings = AGAIN.replace("{warning: iterate_again, abort: iterate_again}", actions)
    test, board = lab.test(repeats=20, more=settings)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING, status
    assert {alarm.channel for alarm in status.hold.alarms} == {"force", "body"}
    assert {alarm.action for alarm in status.hold.alarms if alarm.channel == "body"} == {of_body}
    assert status.hold.reason.startswith("body")
    assert (
        "No drive of road_0 corrects this alarm: body is not controlled, its weight is 0. A correction of the other "
        "alarms would learn its baseline again." in status.hold.reason
    )
    decide(test, status, sequencer_pb2.ENDURANCE_DECISION_KIND_CONTINUE)
    assert wait_for(board, holding_or_ended_after(status.hold)).phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    assert corrections == []
    repeats = [sequencer_pb2.EnduranceRepeat.FromString(step) for kind, step in lab.steps if kind == "EnduranceRepeat"]
    assert all(repeat.baseline for repeat in repeats[:3])
    assert not any(repeat.baseline for repeat in repeats[3:])


LOGGED_FIRST = both_from_repeat(14, body=1.15, body_first=9)
LOG_WARNINGS = AGAIN.replace("warning: iterate_again", "warning: log")


def test_an_alarm_that_was_only_logged_in_an_earlier_repeat_is_not_learned_away(corrections):
    lab = OneRigLab(change=LOGGED_FIRST, made_by=campaign(weights=[1.0, 0.0]))
    test, board = lab.test(repeats=20, more=LOG_WARNINGS)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING, status
    assert {alarm.channel for alarm in status.hold.alarms} == {"force"}
    assert "body is not controlled" in status.hold.reason
    assert status.hold.next_repeat > 10
    # A person who decides so accepts that both baselines are learnt again; the alarm stands no longer.
    decide(test, status, sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN)
    assert wait_for(board, holding_or_ended_after(status.hold)).phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    assert corrections == ["weeks-road_0-1"]


def test_after_a_crash_an_alarm_that_was_only_logged_is_not_learned_away_either(corrections):
    lab = OneRigLab(change=LOGGED_FIRST, made_by=campaign(weights=[1.0, 0.0]))
    lab.interrupt_from = 12
    test, board = lab.test(repeats=20, more=LOG_WARNINGS)
    wait_for(board, lambda status: status.played == 12)
    test.leave()
    assert board.wait_ended(10.0)
    lab.interrupt_from = 1_000_000
    test, board = lab.test(repeats=20, more=LOG_WARNINGS, recorded=messages(lab))
    status = wait_for(board, holding_or_ended)
    assert "body is not controlled" in status.hold.reason
    assert corrections == []
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def holding_or_ended_after(hold):
    return lambda status: holding_or_ended(status) and status.hold.number != hold.number


def test_a_static_change_in_a_band_from_0_hz_corrects_the_drive(corrections):
    lab = OneRigLab(change=from_repeat(12, 0, shift=5.0), made_by=campaign(lowest_frequency=0.0))
    _, board = lab.test(repeats=20, more=AGAIN)
    assert wait_for(board, holding_or_ended).phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    assert corrections == ["weeks-road_0-1"]


def test_an_alarm_in_the_last_repeat_of_all_corrects_nothing_and_the_test_ends(corrections):
    lab = OneRigLab(change=from_repeat(19, 0, gain=1.5), made_by=campaign())
    _, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_FINISHED
    assert status.alarms
    assert "No repeat of road_0 is left, so its drive is not corrected." in status.remarks
    assert corrections == []


def test_an_alarm_in_the_last_repeat_of_an_event_holds_and_a_decision_corrects_nothing(corrections):
    lab = OneRigLab(change=from_repeat(19, 0, gain=1.5), made_by=campaign())
    test, board = lab.test(repeats=20, more=AGAIN, events=2)
    status = wait_for(board, holding_or_ended)
    assert "No repeat of road_0 is left" in status.hold.reason
    decide(test, status, sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN)
    status = wait_for(board, lambda status: status.played > 20 or holding_or_ended(status))
    assert corrections == []
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)
    np.testing.assert_array_equal(np.unique(lab.played), lab.played)
