from __future__ import annotations

import os

import numpy as np
import pytest

from duralab_bus import StreamItem
from duralab_proto.arrays import to_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from recorder.format import files_of
from recorder.log import Archive, Placement
from recorder.reading import audit, describe
from recorder.refused import RefusedError

EPOCH = 11


def item(campaign, block, seq, *, run=None, epoch=EPOCH):
    return StreamItem(Keys().rig_signal(campaign.rig, run or block.run), epoch, seq, block)


@pytest.fixture
def archive(tmp_path, campaign, step_of):
    archive = Archive(tmp_path)
    archive.commit("demo", step_of(0, campaign.specification()))
    archive.commit("demo", step_of(1, campaign.description()))
    archive.commit("demo", step_of(2, campaign.planned("demo.i01")))
    yield archive
    archive.close()


def play(archive, campaign, run="demo.i01", *, leave_out=()):
    for seq, block in enumerate(campaign.blocks(run)):
        if seq not in leave_out:
            archive.take_block(item(campaign, block, seq))


def close(archive, step_of, number):
    archive.commit("demo", step_of(number, recorder_pb2.RecordingClosed(reason="done")))


def test_a_played_run_is_whole_in_its_recording(archive, campaign, step_of, tmp_path):
    play(archive, campaign)
    played = campaign.played("demo.i01", epoch=EPOCH)
    assert archive.gaps("demo", played) == []
    archive.commit("demo", step_of(3, played))
    close(archive, step_of, 4)
    information = describe(tmp_path, "demo")
    assert (information.closed, information.steps) == (True, 5)
    assert (information.signal_blocks, information.missing_blocks) == (4, 0)
    assert audit([tmp_path / "demo.mcap"]).findings == []


def test_missing_blocks_are_counted_and_told(archive, campaign, step_of, tmp_path):
    play(archive, campaign, leave_out={1, 3})
    played = campaign.played("demo.i01", epoch=EPOCH)
    assert archive.gaps("demo", played) == [range(1, 2), range(3, 4)]
    archive.commit("demo", step_of(3, played))
    close(archive, step_of, 4)
    assert describe(tmp_path, "demo").missing_blocks == 2
    assert "lacks 2 of its 4" in audit([tmp_path / "demo.mcap"]).findings[0]


def test_blocks_of_another_epoch_do_not_stand_in(archive, campaign):
    play(archive, campaign)
    assert archive.gaps("demo", campaign.played("demo.i01", epoch=EPOCH + 1)) == [range(4)]


def test_a_block_that_comes_twice_is_stored_once(archive, campaign):
    play(archive, campaign)
    play(archive, campaign)
    assert archive.information("demo").signal_blocks == 4


def test_runs_played_by_hand_go_nowhere(archive, campaign):
    block = campaign.blocks("by_hand")[0]
    assert archive.take_block(item(campaign, block, 0)) is None
    assert archive.information("demo").signal_blocks == 0


@pytest.mark.parametrize(
    "spoil",
    [
        lambda block: setattr(block, "run", "other"),
        lambda block: setattr(block, "sample_rate", 99.0),
        lambda block: block.response.CopyFrom(to_array(np.zeros((3, 50)))),
        lambda block: block.drive.CopyFrom(to_array(np.zeros((2, 49)))),
        lambda block: block.response.CopyFrom(to_array(np.full((2, 50), np.inf))),
        lambda block: setattr(block.drive, "data", b"short"),
    ],
)
def test_a_spoiled_block_reaches_no_log(archive, campaign, spoil):
    block = campaign.blocks("demo.i01")[0]
    spoil(block)
    assert archive.take_block(item(campaign, block, 0, run="demo.i01")) is None
    assert archive.information("demo").signal_blocks == 0


def test_a_sequence_number_beyond_all_bounds_is_refused(archive, campaign):
    assert archive.take_block(item(campaign, campaign.blocks("demo.i01")[0], 2**64 - 1)) is None


def test_a_run_belongs_to_one_recording(archive, campaign, step_of, tmp_path):
    with pytest.raises(RefusedError, match="belongs to recording 'demo'"):
        archive.commit("other", step_of(0, campaign.planned("demo.i01")))
    assert not (tmp_path / "other.mcap").exists()


def test_a_run_that_was_not_announced_cannot_have_been_played(archive, campaign, step_of):
    with pytest.raises(RefusedError, match="commit RunPlanned before") as caught:
        archive.commit("demo", step_of(3, campaign.played("demo.i02", epoch=1)))
    assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION


def test_events_and_states_go_to_their_recording_only(archive, campaign, step_of, tmp_path):
    status = campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING)
    event = iterator_pb2.CampaignEvent(status=status)
    assert archive.take_event(StreamItem(Keys().campaign_event("demo"), 1, 0, event)) == "demo"
    assert archive.take_event(StreamItem(Keys().campaign_event("other"), 1, 0, event)) is None
    state = rig_pb2.RigState(rig=campaign.rig, mode=rig_pb2.RIG_MODE_PLAYING)
    archive.take_state(StreamItem(Keys().rig_state(campaign.rig), 1, 0, state))
    archive.take_state(StreamItem(Keys().rig_state("predecessor"), 1, 0, state))
    close(archive, step_of, 3)
    with (tmp_path / "demo.mcap").open("rb") as stream:
        from mcap.reader import make_reader

        summary = make_reader(stream).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert {topic for topic in topics if not topic.startswith("step/")} == {
        "duralab/v1/local/iterator/event/demo",
        "duralab/v1/local/rig/front_axle/state",
    }


def test_a_recording_from_before_is_not_overwritten(campaign, step_of, tmp_path):
    (tmp_path / "demo.mcap").write_bytes(b"precious")
    with pytest.raises(RefusedError, match="from before") as caught:
        Archive(tmp_path).commit("demo", step_of(0, campaign.specification()))
    assert caught.value.code == query_pb2.FAULT_CODE_ALREADY_EXISTS
    assert (tmp_path / "demo.mcap").read_bytes() == b"precious"


def test_the_last_step_again_is_acknowledged_after_closing(archive, step_of):
    close(archive, step_of, 3)
    assert archive.commit("demo", step_of(3, recorder_pb2.RecordingClosed(reason="done"))) is Placement.STORED


def fail_to_sync(monkeypatch):
    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)


def test_a_step_that_is_not_on_the_disk_is_not_acknowledged(archive, campaign, step_of, monkeypatch, tmp_path):
    with monkeypatch.context() as context:
        fail_to_sync(context)
        with pytest.raises(RefusedError, match="No space left") as caught:
            archive.commit("demo", step_of(3, campaign.model()))
    assert caught.value.code == query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED
    assert archive.commit("demo", step_of(3, campaign.model())) is Placement.NEW
    close(archive, step_of, 4)
    assert [path.name for path in files_of(tmp_path, "demo")] == ["demo.mcap", "demo.part02.mcap"]
    assert audit(files_of(tmp_path, "demo")).findings == []


def test_a_first_step_that_cannot_be_stored_leaves_no_file(campaign, step_of, tmp_path, monkeypatch):
    archive = Archive(tmp_path)
    with monkeypatch.context() as context:
        fail_to_sync(context)
        with pytest.raises(RefusedError, match="No space left"):
            archive.commit("demo", step_of(0, campaign.specification()))
    assert list(tmp_path.iterdir()) == []
    assert archive.commit("demo", step_of(0, campaign.specification())) is Placement.NEW
    archive.close()


def test_stopping_the_recorder_leaves_a_complete_file_that_says_so(archive, tmp_path):
    archive.close()
    assert describe(tmp_path, "demo").closed
    assert audit([tmp_path / "demo.mcap"]).findings == [
        "The last of its 3 steps is not RecordingClosed: it was cut short."
    ]
