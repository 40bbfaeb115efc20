"""An endurance test that has the drive of an event corrected, in a real lab."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import duralab
from duralab_proto.v1 import iterator_pb2, sequencer_pb2

RIG = "front_axle_compliant"
SCHEDULE = {
    "name": "again",
    "rig": RIG,
    "events": {"road": {"drive": "made", "repeats": 24, "missed_target_accepted": True}},
    "monitoring": {"baseline_repeats": 6, "bands": [1.0, 5.0, 20.0]},
    "actions": {"playbacks": 2},
}


@pytest.mark.timeout(600)
def test_iterating_again_gives_the_event_another_drive_and_the_test_goes_on(short_document, tmp_path: Path):
    short_document["name"] = "made"
    campaign, schedule = tmp_path / "made.yaml", tmp_path / "schedule.yaml"
    campaign.write_text(yaml.safe_dump(short_document))
    schedule.write_text(yaml.safe_dump(SCHEDULE))
    recordings = tmp_path / "recordings"
    with duralab.start(tmp_path / "out", rigs=(RIG, "predecessor"), recordings=recordings, endurance=True) as lab:
        made = lab.run(campaign)
        test = lab.endure(schedule)
        test.hold(reason="a bushing was changed")
        held = test.wait(until_hold=True, timeout_seconds=120.0)
        assert held.phase is duralab.EndurancePhase.HOLDING
        test.decide("iterate_again", hold=held.hold, name="Ada", reason="after the change")
        ended = test.wait(timeout_seconds=300.0)
        assert ended.phase is duralab.EndurancePhase.FINISHED, ended
        assert ended.played == 24
    recording = duralab.open_recording(recordings / "again.mcap")
    (drive,) = recording.messages(sequencer_pb2.EnduranceDrive)
    assert drive.campaign == "again-road-1"
    repeats = list(recording.messages(sequencer_pb2.EnduranceRepeat))
    assert {repeat.drive for repeat in repeats[held.played :]} == {1}
    again = duralab.open_recording(recordings / "again-road-1.mcap")
    assert again.model.id == made.recording.model.id
    steps = list(again.messages(iterator_pb2.IterationStep))
    assert len(steps) <= 2
    # It began where the campaign ended, on a specimen that is the same: nothing is lost by it.
    before = made.recording.iterations
    assert again.iterations.judged_error.max(axis=1).min() <= 1.2 * before.judged_error.max(axis=1).min()
