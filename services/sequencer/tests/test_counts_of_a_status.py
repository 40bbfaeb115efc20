"""Status of an endurance test: its counts are those of the recording, also in a hold and after a stop."""

from duralab_proto.v1 import sequencer_pb2

from .one_rig_lab import OneRigLab, holding_or_ended, wait_for

MONITORING = "monitoring: {baseline_repeats: 6, bands: [2, 8, 40]}\n"
HOLD = "actions: {warning: hold, abort: hold}\n" + MONITORING


def louder_from(first):
    return lambda repeat, response: response * (1.5 if repeat >= first else 1.0)


def recorded(lab):
    payloads = [payload for kind, payload in lab.steps if kind == "EnduranceRepeat"]
    return [sequencer_pb2.EnduranceRepeat.FromString(payload) for payload in payloads]


def test_a_hold_by_an_alarm_counts_the_repeat_that_raised_it():
    lab = OneRigLab(change=louder_from(12))
    test, board = lab.test(repeats=20, more=HOLD)
    status = wait_for(board, holding_or_ended)
    alarm = status.hold.alarms[0]
    assert len(recorded(lab)) == alarm.repeat + 1
    assert status.played == status.hold.next_repeat == status.events[0].played == alarm.repeat + 1
    assert status.last_repeat == alarm.repeat
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)
    ended = board.snapshot()
    assert ended.played == alarm.repeat + 1
    assert ended.activity == f"stopped while waiting before repeat {alarm.repeat + 1}"


def test_a_stop_in_a_repeat_counts_it_as_unknown_and_names_it_by_one_number():
    lab = OneRigLab()
    lab.interrupt_from = 8
    test, board = lab.test(repeats=200, more=MONITORING)
    playing = wait_for(board, lambda status: 8 in lab.played and status.activity.startswith("playing repeat 8"))
    assert playing.played == 8
    assert playing.activity == "playing repeat 8 (9 of 200), road_0, on bench"
    test.stop("a hose", latch=False)
    assert board.wait_ended(10.0)
    ended = board.snapshot()
    assert (ended.played, ended.unknown, len(recorded(lab))) == (9, 1, 9)
    assert ended.events[0].unknown == 1
    assert ended.activity.startswith("stopped while playing repeat 8 (9 of 200)")
    assert ended.remarks[-1].startswith("Repeat 8 (road_0) counts as played")
    (stored,) = [payload for kind, payload in lab.steps if kind == "EnduranceStatus"]
    assert sequencer_pb2.EnduranceStatus.FromString(stored).played == 9


def test_a_stop_by_an_alarm_does_not_say_that_the_committed_repeat_plays():
    lab = OneRigLab(change=louder_from(12))
    _, board = lab.test(repeats=20, more="actions: {warning: stop, abort: stop}\n" + MONITORING)
    assert board.wait_ended(20.0)
    ended = board.snapshot()
    assert ended.phase == sequencer_pb2.ENDURANCE_PHASE_STOPPED
    assert ended.played == len(recorded(lab)) == ended.last_repeat + 1
    assert ended.activity.startswith("stopped while preparing the next repeat")
