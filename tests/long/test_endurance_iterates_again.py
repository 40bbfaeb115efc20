"""An endurance test that has the drive of an event corrected, in a real lab."""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml
from one_experiment import identified_by_one_experiment

import duralab
from duralab.recording.files import RecordingFiles
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, recorder_pb2, sequencer_pb2

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
    campaign, schedule = tmp_path / "made.yaml", tmp_path / "schedule.yaml"
    campaign.write_text(yaml.safe_dump(short_document | {"name": "made"}))
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
    # A campaign learns its map again, a correction keeps it.
    assert next(made.recording.messages(iterator_pb2.IterationStep)).HasField("learned_drive_map")
    assert not any(step.HasField("learned_drive_map") for step in steps)
    # A person may have changed the specimen: the present drive is played before two corrections.
    assert len(steps) <= 3
    # It began where the campaign ended, on a specimen that is the same: nothing is lost by it.
    before = made.recording.iterations
    assert again.iterations.judged_error.max(axis=1).min() <= 1.2 * before.judged_error.max(axis=1).min()


@pytest.mark.timeout(600)
def test_a_correction_beyond_an_abort_limit_is_stopped_and_the_rig_latched(short_document, tmp_path: Path):
    campaign, schedule = tmp_path / "made.yaml", tmp_path / "schedule.yaml"
    # One small step, so that the correction has to raise the responses.
    one_step = {"name": "made", "stop": short_document["stop"] | {"iterations": 1}}
    campaign.write_text(yaml.safe_dump(short_document | one_step))
    recordings = tmp_path / "recordings"
    with duralab.start(tmp_path / "out", rigs=(RIG, "predecessor"), recordings=recordings, endurance=True) as lab:
        lab.run(campaign)
        # Every response is beyond such a limit, so a correction passes one as soon as any response grows.
        limits = {channel.name: {"rms": {"abort": [0.0, 1.0e-9]}} for channel in lab.describe(RIG).responses}
        monitoring = SCHEDULE["monitoring"] | {"limits": limits}
        actions = {"playbacks": 5, "abort": "log"}
        schedule.write_text(yaml.safe_dump(SCHEDULE | {"monitoring": monitoring, "actions": actions}))
        test = lab.endure(schedule)
        test.hold(reason="a bushing was changed")
        held = test.wait(until_hold=True, timeout_seconds=120.0)
        test.decide("iterate_again", hold=held.hold, name="Ada", reason="after the change")
        while (after := test.wait(until_hold=True, timeout_seconds=120.0)).hold == held.hold:
            time.sleep(0.1)
        assert after.phase is duralab.EndurancePhase.HOLDING
        assert "passed an abort limit of the schedule" in after.reason
        assert "the drive stays" in after.reason, after.reason
        assert after.played == held.played
        assert lab.state(RIG).mode is duralab.RigMode.INTERLOCKED
        test.stop()
    again = duralab.open_recording(recordings / "again-road-1.mcap")
    assert not list(duralab.open_recording(recordings / "again.mcap").messages(sequencer_pb2.EnduranceDrive))
    assert len(list(again.messages(iterator_pb2.IterationStep))) >= 2


@pytest.mark.timeout(600)
def test_a_sequencer_that_is_killed_in_a_correction_counts_its_playbacks_once(short_document, tmp_path: Path):
    campaign, schedule = tmp_path / "made.yaml", tmp_path / "schedule.yaml"
    campaign.write_text(yaml.safe_dump(short_document | {"name": "made"}))
    schedule.write_text(yaml.safe_dump(SCHEDULE))
    lab_of = {"rigs": (RIG, "predecessor"), "recordings": tmp_path / "recordings", "endurance": True}
    with duralab.start(tmp_path / "out", **lab_of) as lab:
        lab.run(campaign)
        test = lab.endure(schedule)
        test.hold(reason="a bushing was changed")
        held = test.wait(until_hold=True, timeout_seconds=120.0)
        while held.played < 2:
            test.resume()
            test.hold(reason="a bushing was changed")
            held = test.wait(until_hold=True, timeout_seconds=120.0)
        test.decide("iterate_again", hold=held.hold, name="Ada", reason="after the change")
        until = time.monotonic() + 120.0
        while "again-road-1.i02" not in recorded_runs(tmp_path / "recordings" / "again-road-1.mcap"):
            assert time.monotonic() < until, test.progress()
            time.sleep(0.1)
        (sequencer,) = [child for child in psutil.Process().children(recursive=True) if "sequencer" in child.cmdline()]
        sequencer.kill()
        sequencer.wait(10.0)
    # After the first resume it holds, and the second one continues to the end.
    for phase, played in ((duralab.EndurancePhase.HOLDING, held.played), (duralab.EndurancePhase.FINISHED, 24)):
        with duralab.start(tmp_path / "out", **lab_of) as lab:
            test = lab.endurance("again")
            test.resume()
            progress = test.wait(until_hold=True, timeout_seconds=120.0)
            assert (progress.phase, progress.played) == (phase, played)
            announced = recorded_runs(tmp_path / "recordings" / "again-road-1.mcap")
            assert progress.correction_playbacks == len(announced) >= 2
            repeats = damage_of(tmp_path / "recordings", sequencer_pb2.EnduranceRepeat)
            (correction,) = damage_of(tmp_path / "recordings", sequencer_pb2.EnduranceCorrection)
            np.testing.assert_allclose(list(progress.correction_damage.values()), correction)
            np.testing.assert_allclose(list(progress.damage.values()), repeats.sum(axis=0) + correction)
            # Each is about as hard as a repeat.
            assert np.all(correction > 0.2 * len(announced) * repeats.mean(axis=0))


def recorded_runs(path: Path) -> set[str]:
    if not path.exists():
        return set()
    return {step.run for step in RecordingFiles(path).messages(recorder_pb2.RunPlanned)}


def damage_of(recordings: Path, kind: type) -> np.ndarray:
    steps = RecordingFiles(recordings / "again.mcap").messages(kind)
    return np.array([from_array(step.damage, field="damage") for step in steps])


WEARING = "front_axle_wearing"
PART = "left_lower_rear_bushing"


def schedule_of_a_worn_rig() -> dict[str, object]:
    return SCHEDULE | {
        "name": "worn",
        "rig": WEARING,
        "events": {"road": {"drive": "new", "repeats": 30, "missed_target_accepted": True}},
        "actions": {"warning": "iterate_again", "abort": "iterate_again", "playbacks": 3},
    }


@pytest.mark.timeout(1800)
def test_a_bushing_that_lost_a_tenth_is_noticed_and_the_drive_corrected_in_three_playbacks(short_document, tmp_path):
    document = yaml.safe_load((Path(duralab.__file__).parent / "campaign/shipped/front_axle_demo.yaml").read_text())
    document |= {"name": "new", "rig": WEARING, "stop": document["stop"] | {"iterations": 8}}
    document["target"]["road"].update(duration=20.0, potholes=short_document["target"]["road"]["potholes"])
    # With the drive of the demo the change of the lateral force is largest in its static part, which no drive corrects.
    identified_by_one_experiment(document)
    campaign, schedule = tmp_path / "new.yaml", tmp_path / "schedule.yaml"
    campaign.write_text(yaml.safe_dump(document))
    schedule.write_text(yaml.safe_dump(schedule_of_a_worn_rig()))
    recordings = tmp_path / "recordings"
    lab_of = {"rigs": (WEARING, "predecessor"), "recordings": recordings, "endurance": True}
    with duralab.start(tmp_path / "out", **lab_of) as lab:
        lab.run(campaign)
        test = lab.endure(schedule)
        test.hold(reason="the lab is closed overnight")
        first = test.wait(until_hold=True, timeout_seconds=600.0)
        assert first.phase is duralab.EndurancePhase.HOLDING
        # As many as the baseline needs.
        while first.played < 14:
            test.resume()
            test.hold(reason="the lab is closed overnight")
            first = test.wait(until_hold=True, timeout_seconds=600.0)
    # Its entry loses 30 % of stiffness and damping with damage 1, in proportion.
    state = recordings / "wear" / f"{WEARING}.specimen_1.json"
    worn = json.loads(state.read_text())
    assert worn["damage"][PART] < 0.02
    worn["damage"][PART] = 1.0 / 3.0
    state.write_text(json.dumps(worn))
    with duralab.start(tmp_path / "out", **lab_of) as lab:
        test = lab.endurance("worn")
        test.resume()
        ended = test.wait(timeout_seconds=1200.0)
        assert ended.phase is duralab.EndurancePhase.FINISHED, ended
    recording = duralab.open_recording(recordings / "worn.mcap")
    repeats = list(recording.messages(sequencer_pb2.EnduranceRepeat))
    assert [repeat.repeat for repeat in repeats] == list(range(30))
    assert all(repeat.end == sequencer_pb2.REPEAT_END_PLAYED for repeat in repeats)
    assert set(Counter(repeat.run for repeat in repeats).values()) == {1}
    noticed = next(repeat.repeat for repeat in repeats if repeat.alarms)
    assert first.played <= noticed < first.played + 3
    drives = list(recording.messages(sequencer_pb2.EnduranceDrive))
    assert [repeat.drive for repeat in repeats[: noticed + 1]] == [0] * (noticed + 1)
    assert drives[0].campaign == "worn-road-1"
    assert repeats[noticed + 1].drive == 1
    again = duralab.open_recording(recordings / "worn-road-1.mcap")
    assert 1 <= len(list(again.messages(iterator_pb2.IterationStep))) <= 3

    def errors(of):
        return np.sqrt(np.mean(np.square(of.iterations.judged_error), axis=1))

    new = errors(duralab.open_recording(recordings / "new.mcap")).min()
    assert errors(again).min() <= 1.1 * new, (new, errors(again))
