"""Samples that do not follow each other are found, in whatever order their blocks come."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import recorder_pb2
from recorder.format.content import SampleOrder
from recorder.log import Archive
from recorder.reading import verify

RUN = "demo.i01"


def placed(counts):
    """Number, first sample and size of blocks that join."""
    return [(number, sum(counts[:number]), count) for number, count in enumerate(counts)]


def found(blocks):
    order = SampleOrder()
    for number, first, count in blocks:
        order.take(number, first=first, count=count)
    return order.finding


@given(st.lists(st.integers(1, 400), max_size=20), st.randoms(use_true_random=False))
def test_blocks_that_join_have_no_finding_in_any_order(counts, random):
    blocks = placed(counts)
    random.shuffle(blocks)
    assert found(blocks) == ""


@given(
    st.lists(st.integers(1, 400), min_size=1, max_size=20),
    st.integers(1, 9),
    st.data(),
    st.randoms(use_true_random=False),
)
def test_samples_that_are_missing_before_a_block_are_told_with_its_number(counts, lost, data, random):
    from_number = data.draw(st.integers(0, len(counts) - 1))
    blocks = [(number, first + lost * (number >= from_number), count) for number, first, count in placed(counts)]
    random.shuffle(blocks)
    begins = sum(counts[:from_number]) + lost
    if from_number == 0:
        assert found(blocks) == f"its first block begins at sample {begins}"
    else:
        assert found(blocks) == (
            f"block {from_number} begins at sample {begins}, the one before it ends at {begins - lost}"
        )


@pytest.fixture
def recorded(tmp_path, campaign, step_of):
    """Return what is wrong with a recording of some blocks, played to its end or broken off."""

    def record(blocks, *, ended):
        archive = Archive(tmp_path, least_free_bytes=0)
        steps = [campaign.specification(), campaign.description(), campaign.planned(RUN)]
        if ended:
            steps.append(campaign.played(RUN, epoch=7, blocks=len(blocks)))
        for number, message in enumerate([*steps, recorder_pb2.RecordingClosed(reason="done")]):
            if number == 3:
                for seq, block in blocks:
                    archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, seq, block))
            archive.commit("demo", step_of(number, message))
        return list(verify(tmp_path, "demo").findings)

    return record


def test_a_recording_says_where_samples_were_lost_before_they_were_numbered(recorded, campaign):
    blocks = campaign.blocks(RUN)
    del blocks[1]
    assert recorded(list(enumerate(blocks)), ended=True) == [
        f"The samples of run '{RUN}' do not join: block 1 begins at sample 100, the one before it ends at 50."
    ]


def test_a_recording_says_which_blocks_a_run_lacks_that_did_not_end(recorded, campaign):
    blocks = list(enumerate(campaign.blocks(RUN)))
    del blocks[1]
    assert recorded(blocks, ended=False) == [
        f"A playback of run '{RUN}' that did not end lacks 1 blocks before its last."
    ]


def test_a_run_that_was_broken_off_is_whole_as_far_as_it_goes(recorded, campaign):
    assert recorded(list(enumerate(campaign.blocks(RUN)))[:2], ended=False) == []
