"""Damage of the playbacks of campaigns that correct a drive: counted once, whatever ends the campaign or the test."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_loads import channel_damage
from duralab_proto.arrays import from_array, to_record
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, sequencer_pb2
from sequencer.endurance import drive_corrections, iterate_again

from .one_rig_lab import DESCRIPTION, DRIVE, RATE, OneRigLab, campaign, decide, holding_or_ended, messages, wait_for

AGAIN = (
    "actions: {warning: iterate_again, abort: iterate_again}\nmonitoring: {baseline_repeats: 6, bands: [2, 8, 40]}\n"
)
CORRECTION = "weeks-road_0-1"
RESPONSES = [2000.0 * np.vstack([DRIVE, 0.5 * DRIVE]), 1500.0 * np.vstack([DRIVE, 0.7 * DRIVE])]
DAMAGE = np.sum([channel_damage(response, exponents=(5.0,))[:, 0] for response in RESPONSES], axis=0)


def louder(repeat, response):
    return response * (1.5 if repeat >= 12 else 1.0)


def recorded_campaign(*, interrupted=False):
    """Return the recording of a campaign of two playbacks, and a third one that has no result."""
    steps = [campaign()]
    for number, response in enumerate(RESPONSES, start=1):
        run = f"again.{number}"
        record = to_record(DESCRIPTION.responses, RATE, response)
        steps += [
            recorder_pb2.RunPlanned(run=run, rig="bench"),
            iterator_pb2.IterationStep(iteration=number, run=run, response=record),
        ]
    return [*steps, *([recorder_pb2.RunPlanned(run="again.3", rig="bench")] if interrupted else [])]


@pytest.fixture
def lab(monkeypatch):
    """Return a lab in which a correction of a drive records two playbacks and gives the same drive."""
    lab = OneRigLab(change=louder, made_by=campaign())

    def correct(*_, id, **__):
        lab.recordings[id] = recorded_campaign()
        return DRIVE

    monkeypatch.setattr(drive_corrections, "corrected_drive", correct)
    return lab


def of_repeats(lab):
    steps = [step for step in messages(lab) if isinstance(step, sequencer_pb2.EnduranceRepeat)]
    return np.sum([from_array(step.damage, field="damage") for step in steps], axis=0)


def counted(status, name="damage"):
    return from_array(getattr(status, name), field=name)


def test_the_playbacks_of_a_correction_count_with_the_repeats(lab):
    _, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    assert (status.played, status.correction_playbacks) == (20, 2)
    np.testing.assert_allclose(counted(status, "correction_damage"), DAMAGE)
    np.testing.assert_allclose(counted(status), of_repeats(lab) + DAMAGE)
    np.testing.assert_allclose(counted(status.events[0], "correction_damage"), DAMAGE)
    np.testing.assert_allclose(counted(status.events[0]), of_repeats(lab) + DAMAGE)
    (step,) = [step for step in messages(lab) if isinstance(step, sequencer_pb2.EnduranceCorrection)]
    assert (step.playbacks, step.unknown, step.next_repeat) == (2, 0, 13)
    assert "2 playbacks of campaign weeks-road_0-1 count with their damage." in status.remarks


def test_a_correction_that_fails_counts_too_and_its_last_playback_as_a_repeat_with_an_unknown_end(lab, monkeypatch):
    def correct(*_, id, **__):
        lab.recordings[id] = recorded_campaign(interrupted=True)
        raise FaultError(query_pb2.FAULT_CODE_INTERNAL, "The rig left.")

    monkeypatch.setattr(drive_corrections, "corrected_drive", correct)
    test, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    assert status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING
    assert status.correction_playbacks == 3
    np.testing.assert_allclose(counted(status, "correction_damage"), DAMAGE + of_repeats(lab) / status.played)
    # Its name is not free again, and a second attempt counts for itself.
    decide(test, status, sequencer_pb2.ENDURANCE_DECISION_KIND_ITERATE_AGAIN)
    status = wait_for(board, lambda status: status.correction_playbacks == 6)
    assert {"weeks-road_0-1", "weeks-road_0-1-2"} <= lab.recordings.keys()
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def test_a_campaign_that_never_began_counts_nothing(lab, monkeypatch):
    def correct(*_, **__):
        raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, "There is no iterator.")

    monkeypatch.setattr(drive_corrections, "corrected_drive", correct)
    test, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    assert "There is no iterator." in status.hold.reason
    assert status.correction_playbacks == 0
    np.testing.assert_allclose(counted(status), of_repeats(lab))
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def test_a_sequencer_that_is_killed_at_any_step_counts_a_correction_once(lab):
    _, board = lab.test(repeats=20, more=AGAIN)
    assert wait_for(board, holding_or_ended).correction_playbacks == 2
    steps = messages(lab)
    planned = next(place for place, step in enumerate(steps) if isinstance(step, sequencer_pb2.CorrectionPlanned))
    killed_after = range(planned, planned + 6)
    assert any(isinstance(steps[place], sequencer_pb2.EnduranceCorrection) for place in killed_after)
    for place in killed_after:
        again = OneRigLab(change=lambda _repeat, response: 1.5 * response, made_by=campaign())
        again.recordings[CORRECTION] = recorded_campaign()
        test, board = again.test(repeats=20, more=AGAIN, recorded=steps[: place + 1])
        status = wait_for(board, holding_or_ended)
        if status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING:
            assert status.hold.reason == "Iterating again was broken off."
        test.stop("enough", latch=False)
        assert board.wait_ended(10.0)
        status = board.snapshot()
        assert status.correction_playbacks == 2, place
        np.testing.assert_allclose(counted(status, "correction_damage"), DAMAGE)


# Playback 1 of the correction has 7.07 N RMS of the body's force and playback 2 has 7.42 N, a repeat before the change
# 7.07 N.
LIMITED = AGAIN.replace("bands:", "limits: {body: {rms: {abort: [0, 7.2]}}}, bands:")


def killed_in_a_correction(lab, *, present=None):
    """Return another lab, and its resumed test and board: the sequencer was killed, and its correction still runs."""
    _, board = lab.test(repeats=20, more=LIMITED)
    wait_for(board, holding_or_ended)
    steps = messages(lab)
    planned = next(place for place, step in enumerate(steps) if isinstance(step, sequencer_pb2.CorrectionPlanned))
    again = OneRigLab(change=lambda _repeat, response: 1.5 * response, made_by=campaign())
    spec, *playbacks = recorded_campaign()
    if present is not None:
        spec.known.first_drive.response.CopyFrom(to_record(DESCRIPTION.responses, RATE, present))
    again.recordings[CORRECTION] = [spec, *playbacks]
    again.running[CORRECTION] = iterator_pb2.CampaignStatus(
        id=CORRECTION, phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING, iterations=[{"iteration": 1}, {"iteration": 2}]
    )
    return again, *again.test(repeats=20, more=LIMITED, recorded=steps[: planned + 1])


@pytest.mark.parametrize("present", [None, 0.5 * RESPONSES[0]])
def test_after_a_kill_a_correction_beyond_an_abort_limit_is_stopped(lab, present):
    again, test, board = killed_in_a_correction(lab, present=present)
    status = wait_for(board, holding_or_ended)
    assert again.running[CORRECTION].phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    sentence = f"In campaign {CORRECTION} playback 2 passed an abort limit of the schedule (body: rms "
    assert f"Iterating again was broken off. {sentence}" in status.hold.reason
    (step,) = [step for step in messages(again) if isinstance(step, sequencer_pb2.EnduranceCorrection)]
    assert sentence in step.reason
    assert status.correction_playbacks == 2
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def test_after_a_kill_a_correction_that_is_no_farther_outside_than_the_present_drive_goes_on(lab, monkeypatch):
    monkeypatch.setattr(iterate_again, "_POLL_SECONDS", 0.01)
    again, test, board = killed_in_a_correction(lab, present=3.0 * RESPONSES[0])
    wait_for(board, lambda status: CORRECTION in status.activity)
    running = again.running[CORRECTION]
    assert running.phase == iterator_pb2.CAMPAIGN_PHASE_ITERATING
    running.phase = iterator_pb2.CAMPAIGN_PHASE_FINISHED
    status = wait_for(board, holding_or_ended)
    assert status.hold.reason == "Iterating again was broken off."
    test.stop("enough", latch=False)
    assert board.wait_ended(10.0)


def test_a_later_recording_goes_on_with_the_damage_of_the_corrections_before(lab):
    _, board = lab.test(repeats=20, more=AGAIN)
    status = wait_for(board, holding_or_ended)
    volume = sequencer_pb2.EnduranceVolume(id="weeks", number=2, first_repeat=20, events=status.events)
    _, board = OneRigLab(made_by=campaign()).test(repeats=20, more=AGAIN, recorded=[volume])
    ended = wait_for(board, holding_or_ended)
    assert ended.correction_playbacks == 2
    np.testing.assert_allclose(counted(ended), counted(status))


def test_a_recording_from_before_corrections_were_counted_is_read(lab):
    _, board = lab.test(repeats=20, more=AGAIN)
    wait_for(board, holding_or_ended)
    new = sequencer_pb2.CorrectionPlanned | sequencer_pb2.EnduranceCorrection
    steps = [step for step in messages(lab) if not isinstance(step, new)]
    for step in steps:
        if isinstance(step, sequencer_pb2.EnduranceVolume):
            step.events[0].ClearField("correction_damage")
    test, board = OneRigLab(made_by=campaign()).test(repeats=20, more=AGAIN, recorded=steps[:-4])
    status = wait_for(board, holding_or_ended)
    assert status.correction_playbacks == 0
    np.testing.assert_allclose(counted(status, "correction_damage"), 0.0)
    test.stop("enough", latch=False)
