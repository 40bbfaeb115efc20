"""A disk that fails at the worst moments: while a recording is closed, and again while what was held is written."""

from __future__ import annotations

import errno
import time

import pytest

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2
from recorder.log import Archive, Placement
from recorder.mcap_log import McapLog
from recorder.reading import verify
from recorder.refused import RefusedError

EPOCH = 11
RETRY_SECONDS = 0.05


@pytest.fixture
def archive(tmp_path, campaign, step_of, monkeypatch):
    monkeypatch.setattr("recorder.log.interruptions.RETRY_SECONDS", RETRY_SECONDS)
    archive = Archive(tmp_path, least_free_bytes=0)
    for number, message in enumerate([campaign.specification(), campaign.description(), campaign.planned("demo.i01")]):
        archive.commit("demo", step_of(number, message))
    yield archive
    archive.close()


@pytest.fixture
def refuse(monkeypatch):
    """Let a method of the log fail for so many calls from now on."""

    def begin(method, *, times):
        whole, left = getattr(McapLog, method), [times]

        def call(self, *arguments, **options):
            if left[0]:
                left[0] -= 1
                raise OSError(errno.ENOSPC, "No space left on device")
            return whole(self, *arguments, **options)

        monkeypatch.setattr(McapLog, method, call)

    return begin


def blocks_of(campaign):
    key = Keys().rig_signal(campaign.rig, "demo.i01")
    return [StreamItem(key, EPOCH, seq, block) for seq, block in enumerate(campaign.blocks("demo.i01"))]


def event_of(campaign, seq=0):
    status = campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING)
    return StreamItem(Keys().campaign_event("demo"), 7, seq, iterator_pb2.CampaignEvent(status=status))


def settle(archive):
    """Let the disk's retry come, and return what is safe or let go of."""
    settled = []
    for _ in range(3):
        archive.sync()
        settled += archive.take_settled()
        time.sleep(1.5 * RETRY_SECONDS)
    return settled


def test_a_disk_that_fills_up_while_a_recording_is_closed_leaves_nothing_behind(
    archive, campaign, step_of, refuse, tmp_path
):
    items = [*blocks_of(campaign), event_of(campaign)]
    for item in items[:-1]:
        archive.take_block(item)
    archive.commit("demo", step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    archive.take_event(items[-1])
    refuse("close", times=1)
    last = step_of(4, recorder_pb2.RecordingClosed(reason="done"))
    with pytest.raises(RefusedError):
        archive.commit("demo", last)
    assert archive.commit("demo", last) is Placement.STORED
    assert settle(archive) == items
    assert archive.counts() == (0, 0)
    # The run's name is free again.
    archive.commit("other", step_of(0, campaign.planned("demo.i01")))
    assert verify(tmp_path, "demo").whole


def test_a_disk_that_fails_again_while_what_was_held_is_written_loses_nothing(
    archive, campaign, step_of, refuse, tmp_path
):
    first, *others = blocks_of(campaign)
    archive.take_block(first)
    refuse("sync", times=1)
    archive.sync()
    for item in others:
        archive.take_block(item)
    refuse("add_message", times=1)
    with pytest.raises(RefusedError):
        archive.commit("demo", step_of(3, campaign.planned("demo.i02")))
    assert archive.counts() == (0, 1)
    event = event_of(campaign)
    archive.take_event(event)
    assert {(item.key, item.seq) for item in settle(archive)} == {
        (item.key, item.seq) for item in [first, *others, event]
    }
    archive.commit("demo", step_of(3, campaign.planned("demo.i02")))
    archive.commit("demo", step_of(4, campaign.played("demo.i01", epoch=EPOCH)))
    archive.commit("demo", step_of(5, recorder_pb2.RecordingClosed(reason="done")))
    result = verify(tmp_path, "demo")
    assert result.whole, result.findings


def test_a_state_of_the_run_that_goes_on_is_kept_after_a_kill(archive, campaign, tmp_path):
    archive.take_block(blocks_of(campaign)[0])
    archive.sync()
    again = Archive(tmp_path, least_free_bytes=0)
    again.recover()
    state = campaign.state(rig_pb2.RIG_MODE_INTERLOCKED, reason="force limit of left_vertical", run="demo.i01")
    item = StreamItem(Keys().rig_state(campaign.rig), 5, 0, state)
    assert again.take_state(item) == {"demo"}
    assert again.take_settled() == []
    again.close()
    assert again.take_settled() == [item]
