"""Steps of an endurance test: repeats with kept samples, and repeats whose signal blocks are dropped."""

import numpy as np
import pytest

from duralab_bus import StreamItem
from duralab_proto.arrays import to_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from recorder.log import Archive
from recorder.reading import audit, describe
from recorder.refused import RefusedError

EPOCH = 11


def volume(campaign, **more):
    return sequencer_pb2.EnduranceVolume(id="demo", rig=campaign.rig, number=1, **more)


def unkept(campaign, run):
    return recorder_pb2.RunPlanned(run=run, rig=campaign.rig, purpose="repeat 0", not_kept=True)


@pytest.fixture
def archive(tmp_path, campaign, step_of):
    archive = Archive(tmp_path)
    archive.commit("demo", step_of(0, sequencer_pb2.EnduranceSpec(id="demo", rig=campaign.rig)))
    archive.commit("demo", step_of(1, volume(campaign)))
    archive.commit("demo", step_of(2, campaign.description()))
    yield archive
    archive.close()


def block_item(campaign, block, seq):
    return StreamItem(Keys().rig_signal(campaign.rig, block.run), EPOCH, seq, block)


def test_blocks_of_a_run_that_is_not_kept_are_dropped_and_their_rig_need_not_keep_them(
    archive, campaign, step_of, tmp_path
):
    archive.commit("demo", step_of(3, unkept(campaign, "demo.r0000000")))
    blocks = [block_item(campaign, block, seq) for seq, block in enumerate(campaign.blocks("demo.r0000000"))]
    assert [archive.take_block(block) for block in blocks] == [None] * len(blocks)
    assert archive.take_settled() == blocks
    repeat = sequencer_pb2.EnduranceRepeat(
        run="demo.r0000000",
        end=sequencer_pb2.REPEAT_END_PLAYED,
        statistics=to_array(np.full((2, 3), np.nan)),
        damage=to_array(np.zeros(2)),
    )
    archive.commit("demo", step_of(4, repeat))
    archive.commit("demo", step_of(5, sequencer_pb2.EnduranceStatus(phase=sequencer_pb2.ENDURANCE_PHASE_FINISHED)))
    archive.commit("demo", step_of(6, recorder_pb2.RecordingClosed(reason="done")))
    information = describe(tmp_path, "demo")
    assert (information.signal_blocks, information.missing_blocks) == (0, 0)
    assert (information.rig, information.target) == (campaign.rig, "endurance test demo")
    assert information.phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert audit([tmp_path / "demo.mcap"]).findings == []


def test_states_of_a_run_that_is_not_kept_are_not_written(archive, campaign, step_of):
    archive.commit("demo", step_of(3, campaign.planned("demo.r0000000")))
    archive.commit("demo", step_of(4, unkept(campaign, "demo.r0000001")))
    key = Keys().rig_state(campaign.rig)
    kept, dropped = (
        StreamItem(key, EPOCH, seq, rig_pb2.RigState(rig=campaign.rig, run=run))
        for seq, run in enumerate(("demo.r0000000", "demo.r0000001"))
    )
    assert archive.take_state(kept) == {"demo"}
    assert archive.take_state(dropped) == set()
    assert dropped in archive.take_settled()


def test_a_repeat_that_leaves_its_samples_to_blocks_that_are_not_here_is_refused(archive, campaign, step_of):
    archive.commit("demo", step_of(3, campaign.planned("demo.r0000000")))
    repeat = sequencer_pb2.EnduranceRepeat(
        run="demo.r0000000", samples_hash="0" * 64, signal_epoch=EPOCH, signal_blocks=4
    )
    with pytest.raises(RefusedError, match="send the step with its samples") as refused:
        archive.commit("demo", step_of(4, repeat), samples_hash="")
    assert refused.value.field == "payload.samples_hash"


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (sequencer_pb2.EnduranceSpec(id="Demo", rig="front"), "payload.id"),
        (sequencer_pb2.EnduranceVolume(id="demo", rig="Front"), "payload.rig"),
        (sequencer_pb2.EnduranceRepeat(run="a b"), "payload.run"),
        (sequencer_pb2.EnduranceRepeat(run="a", samples_hash="xyz"), "payload.samples_hash"),
        (sequencer_pb2.EnduranceRepeat(run="a", damage=to_array(np.array([np.nan]))), "payload.damage"),
        (sequencer_pb2.RepeatSamples(run="a"), "payload.response"),
    ],
    ids=["id", "rig", "run", "hash", "damage", "samples"],
)
def test_a_step_that_is_none_is_refused_with_its_field(message, field, step_of):
    with pytest.raises(RefusedError) as refused:
        step_of(0, message)
    assert refused.value.field.startswith(field)
