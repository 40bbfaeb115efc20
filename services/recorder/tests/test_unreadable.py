"""Files that cannot be read, were deleted or find no room for their copy: they harm nothing but themselves."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path
from unittest import mock

import pytest

from duralab_bus import Call, StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.config import RecorderConfig
from recorder.log import Archive, Placement, recovery
from recorder.refused import RefusedError
from recorder.service import RecorderService


@pytest.fixture
def folder(tmp_path, campaign, step_of):
    """A recording that is ended, and one whose recorder was killed."""
    archive = Archive(tmp_path, least_free_bytes=0)
    archive.commit("old", step_of(0, campaign.specification()))
    archive.commit("old", step_of(1, recorder_pb2.RecordingClosed(reason="done")))
    archive.commit("killed", step_of(0, campaign.specification()))
    content = (tmp_path / "killed.mcap").read_bytes()
    archive.close()
    (tmp_path / "killed.mcap").write_bytes(content)
    return tmp_path


@pytest.fixture
def unreadable(folder, monkeypatch):
    """Refuse to open the file of the ended one, as its owner or a bad sector does: root may read everything."""
    opened = Path.open

    def refuse(path, *arguments, **options):
        if path.name == "old.mcap":
            raise OSError(errno.EIO, "Input/output error")
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", refuse)
    return folder


def blocks_by_hand(campaign):
    key = Keys().rig_signal(campaign.rig, "by_hand")
    return [StreamItem(key, 7, seq, block) for seq, block in enumerate(campaign.blocks("by_hand"))]


def test_a_file_that_cannot_be_read_holds_up_the_lab_for_a_bounded_time(unreadable, campaign, monkeypatch):
    archive = Archive(unreadable, least_free_bytes=0)
    archive.recover()
    assert archive.waiting("old") == "Input/output error"
    for item in blocks_by_hand(campaign):
        archive.take_block(item)
    archive.sync()
    assert archive.take_settled() == []
    monkeypatch.setattr("recorder.log.interruptions.time.monotonic", lambda: 1e9)
    archive.sync()
    assert [item.seq for item in archive.take_settled()] == [0, 1, 2, 3]
    archive.take_block(blocks_by_hand(campaign)[0])
    assert [item.seq for item in archive.take_settled()] == [0]
    archive.close()


def test_a_file_that_cannot_be_read_is_listed_as_such_beside_the_others(unreadable):
    service = RecorderService(RecorderConfig(folder=unreadable, live_file=False, least_free_mebibytes=0))
    try:
        call = mock.create_autospec(Call, instance=True)
        found = service.list_recordings(recorder_pb2.ListRecordingsRequest(), call).recordings
    finally:
        service.close()
    assert {one.recording: one.waiting for one in found} == {
        "killed": "",
        "old": "It cannot be read: Input/output error.",
    }


def test_the_steps_of_a_deleted_recording_are_acknowledged_no_more(tmp_path, campaign, step_of):
    archive = Archive(tmp_path, least_free_bytes=0)
    ending = step_of(1, recorder_pb2.RecordingClosed(reason="done"))
    for _ in range(2):
        assert archive.commit("demo", step_of(0, campaign.specification())) is Placement.NEW
        assert archive.commit("demo", ending) is Placement.NEW
        assert archive.commit("demo", ending) is Placement.STORED
        (tmp_path / "demo.mcap").unlink()
        with pytest.raises(RefusedError, match="the next step is 0"):
            archive.commit("demo", ending)


def test_no_copy_is_begun_that_would_take_what_is_kept_free(folder, monkeypatch):
    size = (folder / "killed.mcap").stat().st_size
    room = mock.Mock(return_value=shutil.disk_usage(folder)._replace(free=size + 999))
    monkeypatch.setattr(recovery.shutil, "disk_usage", room)
    archive = Archive(folder, least_free_bytes=1000)
    archive.recover()
    assert "a copy of killed.mcap takes" in archive.waiting("killed")
    assert not (folder / "damaged").exists()
    room.return_value = room.return_value._replace(free=size + 1000)
    archive._take_up_interrupted("killed")
    assert not archive.waiting("killed")
    assert (folder / "damaged" / "killed.mcap").stat().st_size == size
    archive.close()


def test_a_folder_that_is_away_pauses_a_campaign(tmp_path, campaign, step_of):
    folder = tmp_path / "recordings"
    folder.mkdir()
    archive = Archive(folder)
    folder.rename(tmp_path / "elsewhere")
    with pytest.raises(RefusedError, match="cannot be written now") as refusal:
        archive.commit("demo", step_of(0, campaign.specification()))
    assert refusal.value.code == query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED


def test_a_view_ends_also_where_the_disk_refused_the_ending_the_first_time(tmp_path, campaign, request_of, monkeypatch):
    service = RecorderService(RecorderConfig(folder=tmp_path, live_file=True, least_free_mebibytes=0))
    call, bus = mock.create_autospec(Call, instance=True), mock.Mock()
    try:
        service.commit(bus, request_of(0, campaign.specification()), call)
        ending = request_of(1, recorder_pb2.RecordingClosed(reason="done"))
        with monkeypatch.context() as patched:
            patched.setattr(
                "recorder.mcap_log.McapLog.close", mock.Mock(side_effect=OSError(errno.ENOSPC, "No space left"))
            )
            with pytest.raises(RefusedError, match="cannot be written now"):
                service.commit(bus, ending, call)
        service.commit(bus, ending, call)
        assert not service._views._views
    finally:
        service.close()
