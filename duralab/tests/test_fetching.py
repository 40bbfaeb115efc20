from __future__ import annotations

import errno
import hashlib
import os
import threading

import pytest

from duralab.errors import LabError
from duralab.lab import fetching
from duralab.lab.fetching import Part, fetch, fetch_result
from duralab.lab.recordings_folder import RecordingsPlace, own_recordings
from duralab_bus import FaultError
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2

CONTENT = bytes(range(256)) * 40


class Recorder:
    """Answers as a recorder does, in a process of its own that is not needed here."""

    def __init__(self, content: bytes = CONTENT, *, total: int | None = None) -> None:
        self.keys = Keys()
        self.content = content
        self.total = len(content) if total is None else total
        self.asked: list[int] = []
        self.at_once = 0
        self.most_at_once = 0
        self._lock = threading.Lock()

    def query(self, _key, request, _kind) -> recorder_pb2.RecordingPart:
        with self._lock:
            self.asked.append(request.offset)
            self.at_once += 1
            self.most_at_once = max(self.most_at_once, self.at_once)
        piece = self.content[request.offset : request.offset + request.length]
        with self._lock:
            self.at_once -= 1
        return recorder_pb2.RecordingPart(offset=request.offset, data=piece, total=self.total)


@pytest.fixture(autouse=True)
def short_pieces(monkeypatch):
    monkeypatch.setattr(fetching, "PART_BYTES", 1000)


def fetched(bus, path, **options) -> bytes:
    fetch(bus, "demo", part=Part.RECORDING, path=path, **options)
    return path.read_bytes()


def test_the_pieces_are_put_together_in_their_order_and_checked(tmp_path):
    bus = Recorder()
    digest = hashlib.sha256(CONTENT).hexdigest()
    assert fetched(bus, tmp_path / "a.mcap", file_hash=digest) == CONTENT
    assert sorted(bus.asked) == list(range(0, len(CONTENT), 1000)), "each piece once"
    assert bus.most_at_once <= fetching.PARTS_AHEAD


def test_an_empty_file_is_fetched(tmp_path):
    assert fetched(Recorder(b""), tmp_path / "a.mcap") == b""


def test_a_file_that_is_cut_off_is_not_kept(tmp_path):
    with pytest.raises(LabError, match="sent 4321 of 10240 bytes of 'demo'"):
        fetched(Recorder(CONTENT[:4321], total=len(CONTENT)), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_recorder_that_dies_on_the_way_leaves_nothing(tmp_path):
    class Dying(Recorder):
        def query(self, key, request, kind):
            if request.offset >= 5000:
                raise FaultError(0, "The recorder is gone.")
            return super().query(key, request, kind)

    with pytest.raises(FaultError, match="is gone"):
        fetched(Dying(), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_live_file_of_before_does_not_stay_beside_a_recording_that_has_none(tmp_path):
    class WithoutLiveFile(Recorder):
        def query(self, key, request, kind):
            if kind is recorder_pb2.RecordingInfo:
                return recorder_pb2.RecordingInfo(recording="demo", closed=True)
            if request.part == Part.LIVE.value:
                raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, "There is no live file.")
            return super().query(key, request, kind)

    (tmp_path / "live.rrd").write_bytes(b"of another campaign")
    specification = iterator_pb2.CampaignSpec(id="demo")
    status = iterator_pb2.CampaignStatus()
    result = fetch_result(WithoutLiveFile(), specification, status, folder=tmp_path, place=RecordingsPlace())
    assert result.recording_path.read_bytes() == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["recording.mcap"]


class Closed(Recorder):
    """A recorder whose recording of two files is closed."""

    def query(self, key, request, kind):
        if kind is recorder_pb2.RecordingInfo:
            files = [recorder_pb2.RecordingFile(), recorder_pb2.RecordingFile()]
            return recorder_pb2.RecordingInfo(recording="demo", closed=True, files=files)
        return super().query(key, request, kind)


def handed_over(place, folder, *, files) -> Closed:
    """Fetch the result of a campaign whose files lie in the folder of a lab's recorder."""
    for name in files:
        (place.folder / name).write_bytes(CONTENT)
    recorder, specification = Closed(), iterator_pb2.CampaignSpec(id="demo")
    result = fetch_result(recorder, specification, iterator_pb2.CampaignStatus(), folder=folder, place=place)
    assert (result.recording_path, result.live_path) == (folder / "recording.mcap", folder / "live.rrd")
    for name in ("recording.mcap", "recording.part02.mcap", "live.rrd"):
        assert (folder / name).read_bytes() == CONTENT
    return recorder


def test_the_files_of_a_private_lab_are_linked_and_no_byte_is_copied(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "recording.part03.mcap").write_bytes(b"of a longer recording")
    with own_recordings(folder) as place:
        recorder = handed_over(place, folder, files=("demo.mcap", "demo.part02.mcap", "demo.rrd"))
        assert (place.folder / "demo.mcap").samefile(folder / "recording.mcap")
        assert (place.folder / "demo.part02.mcap").samefile(folder / "recording.part02.mcap")
        assert (place.folder / "demo.rrd").samefile(folder / "live.rrd")
        place.fetched.add("demo")
    assert recorder.asked == []
    assert sorted(path.name for path in folder.iterdir()) == ["live.rrd", "recording.mcap", "recording.part02.mcap"]


def test_a_lab_that_keeps_its_recordings_gives_copies(tmp_path):
    """A user who edits a linked file would edit the recording of the lab."""
    (tmp_path / "recordings").mkdir()
    place = RecordingsPlace(tmp_path / "recordings")
    recorder = handed_over(place, tmp_path / "out", files=("demo.mcap", "demo.part02.mcap", "demo.rrd"))
    assert recorder.asked
    assert not (place.folder / "demo.mcap").samefile(tmp_path / "out" / "recording.mcap")


@pytest.mark.parametrize("files", [("demo.mcap", "demo.part02.mcap", "demo.rrd"), ("demo.mcap", "demo.rrd"), ()])
def test_files_that_cannot_be_linked_are_fetched(tmp_path, monkeypatch, files):
    def other_disk(_source, _path):
        raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))

    if len(files) == 3:
        monkeypatch.setattr(os, "link", other_disk)
    with own_recordings(tmp_path / "out") as place:
        assert handed_over(place, tmp_path / "out", files=files).asked
        place.fetched.add("demo")
