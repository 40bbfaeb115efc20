"""A disk that is full, read-only or short of room: the recording waits, nothing that was acknowledged is harmed."""

from __future__ import annotations

import os
import subprocess

import numpy as np
import pytest

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.format import read_summary
from recorder.log import Archive, Placement
from recorder.log.recovery import KILLED
from recorder.reading import describe, verify
from recorder.refused import RefusedError

EPOCH = 11
SIZE = 2 * 1024 * 1024


@pytest.fixture
def small_disk(mount_disk):
    """A file system of 2 MiB."""
    return mount_disk("disk", SIZE)


def fill(folder, *, leave):
    """Take all of the disk but a few bytes, as another program does."""
    free = os.statvfs(folder)
    (folder / "filler").write_bytes(b"\1" * max(0, free.f_bavail * free.f_frsize - leave))


def remount(folder, how):
    subprocess.run(["mount", "-o", f"remount,{how}", str(folder)], check=True)


@pytest.fixture
def archive(small_disk, campaign, step_of, monkeypatch):
    monkeypatch.setattr("recorder.log.interruptions.RETRY_SECONDS", 0.0)
    archive = Archive(small_disk, least_free_bytes=64 * 1024)
    for number, message in enumerate([campaign.specification(), campaign.description(), campaign.planned("demo.i01")]):
        archive.commit("demo", step_of(number, message))
    yield archive
    archive.close()


def blocks_of(campaign, *, first=0, stop=4):
    key = Keys().rig_signal(campaign.rig, "demo.i01")
    # Noise does not compress: three blocks never fit into what is left of a file's last page of 4 KiB.
    noise = np.random.default_rng(4).uniform(0.5, 1.5, (2, 50))
    blocks = campaign.blocks("demo.i01", gain=noise, drive_gain=1e-6 * noise)
    return [StreamItem(key, EPOCH, seq, block) for seq, block in enumerate(blocks)][first:stop]


def finish(archive, campaign, step_of):
    archive.commit("demo", step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))


def refused(archive, step):
    with pytest.raises(RefusedError) as caught:
        archive.commit("demo", step)
    assert caught.value.code == query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED
    return caught.value.message


def test_a_full_disk_interrupts_and_the_recording_goes_on_whole_when_there_is_room(
    archive, small_disk, campaign, step_of
):
    for item in blocks_of(campaign, stop=1):
        archive.take_block(item)
    archive.sync()
    acknowledged = (small_disk / "demo.mcap").read_bytes()
    fill(small_disk, leave=0)
    for item in blocks_of(campaign, first=1):
        archive.take_block(item)
    archive.sync()
    assert archive.waiting("demo")
    refused(archive, step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    # Not one of the blocks that are only in memory counts as safe.
    assert {item.seq for item in archive.take_settled()} == {0}
    assert (small_disk / "demo.mcap").read_bytes()[: len(acknowledged)] == acknowledged
    (small_disk / "filler").unlink()
    archive.sync()
    assert not archive.waiting("demo")
    archive.sync()
    assert {item.seq for item in archive.take_settled()} == {1, 2, 3}
    finish(archive, campaign, step_of)
    result = verify(small_disk, "demo")
    assert result.whole, result.findings
    assert describe(small_disk, "demo").signal_blocks == 4


def test_blocks_that_come_while_it_waits_are_held_and_written_later(archive, small_disk, campaign, step_of):
    fill(small_disk, leave=0)
    message = campaign.model()
    refused(archive, step_of(3, message))
    for item in blocks_of(campaign):
        assert archive.take_block(item) is None
    assert archive.take_settled() == []
    (small_disk / "filler").unlink()
    finish(archive, campaign, step_of)
    assert verify(small_disk, "demo").whole


def test_a_campaign_pauses_before_the_disk_is_full(archive, small_disk, campaign, step_of):
    fill(small_disk, leave=32 * 1024)
    message = refused(archive, step_of(3, campaign.planned("demo.i02")))
    assert "MiB are kept free" in message
    # What was measured already still finds its place.
    for item in blocks_of(campaign):
        assert archive.take_block(item) == "demo"
    archive.commit("demo", step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    assert not archive.waiting("demo")
    (small_disk / "filler").unlink()
    assert archive.commit("demo", step_of(4, campaign.planned("demo.i02"))) is Placement.NEW


def test_a_folder_that_turns_read_only_interrupts_too(archive, small_disk, campaign, step_of):
    # Nothing may be open for writing when a file system turns read-only; the next file needs the folder.
    archive.close()
    archive.recover()
    remount(small_disk, "ro")
    try:
        assert "Read-only" in refused(archive, step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    finally:
        remount(small_disk, "rw")
    for item in blocks_of(campaign):
        archive.take_block(item)
    finish(archive, campaign, step_of)
    assert verify(small_disk, "demo").whole


def test_a_disk_that_fills_up_again_and_again_costs_nothing(archive, small_disk, campaign, step_of):
    for item in blocks_of(campaign):
        fill(small_disk, leave=0)
        archive.take_block(item)
        archive.sync()
        (small_disk / "filler").unlink()
        archive.sync()
    finish(archive, campaign, step_of)
    result = verify(small_disk, "demo")
    assert result.whole, result.findings


def test_a_recorder_that_starts_on_a_full_disk_waits_with_its_repair(small_disk, archive, campaign, step_of):
    for item in blocks_of(campaign):
        archive.take_block(item)
    archive.sync()
    fill(small_disk, leave=0)
    after = Archive(small_disk, least_free_bytes=64 * 1024)
    after.recover()
    assert after.waiting("demo")
    refused(after, step_of(3, campaign.played("demo.i01", epoch=EPOCH)))
    (small_disk / "filler").unlink()
    finish(after, campaign, step_of)
    assert verify(small_disk, "demo").whole


@pytest.fixture
def killed_on_a_full_disk(archive, small_disk, campaign):
    """What a killed recorder left, one block of four safe and a record torn, on a disk that is full now."""
    archive.take_block(blocks_of(campaign)[0])
    archive.sync()
    archive.take_settled()
    file = small_disk / "demo.mcap"
    file.write_bytes(file.read_bytes() + b"\x06torn")
    fill(small_disk, leave=0)
    again = Archive(small_disk, least_free_bytes=0)
    again.recover()
    assert again.waiting("demo")
    return again


def test_what_spools_replay_while_a_killed_recording_waits_for_its_repair_is_held(
    killed_on_a_full_disk, small_disk, campaign, step_of
):
    again = killed_on_a_full_disk
    state = StreamItem(Keys().rig_state(campaign.rig), 5, 0, campaign.state(3, reason="force limit", run="demo.i01"))
    for item in blocks_of(campaign):
        assert again.take_block(item) is None
    assert again.take_state(state) == set()
    again.sync()
    # Nothing counts as stored: the publishers keep it.
    assert again.take_settled() == []
    (small_disk / "filler").unlink()
    again.sync()
    again.sync()
    assert {item.seq for item in again.take_settled() if item is not state} == {0, 1, 2, 3}
    finish(again, campaign, step_of)
    result = verify(small_disk, "demo")
    assert result.whole, result.findings
    assert describe(small_disk, "demo").signal_blocks == 4


def test_the_original_of_a_killed_file_is_kept_although_its_repair_had_to_wait(killed_on_a_full_disk, small_disk):
    (small_disk / "filler").unlink()
    killed_on_a_full_disk.sync()
    assert not killed_on_a_full_disk.waiting("demo")
    assert (small_disk / "damaged" / "demo.mcap").read_bytes().endswith(b"\x06torn")
    summary = read_summary(small_disk / "demo.mcap")
    assert summary is not None
    assert summary.reason == KILLED
