from __future__ import annotations

import hashlib

import pytest

from duralab_proto.v1 import query_pb2, recorder_pb2
from recorder.format import existing_file, recordings_in
from recorder.log import Archive
from recorder.reading import describe, read_part, verify
from recorder.refused import RefusedError


@pytest.fixture
def folder(tmp_path, campaign, step_of):
    archive = Archive(tmp_path)
    for number, message in enumerate(
        [campaign.specification(), campaign.model(), recorder_pb2.RecordingClosed(reason="done")]
    ):
        archive.commit("demo", step_of(number, message))
    return tmp_path


def part(offset=0, length=1000, which="recording"):
    return recorder_pb2.ReadRecordingRequest(offset=offset, length=length, part=which)


@pytest.mark.parametrize(
    "name", ["", "..", "../demo", "demo/../demo", "/etc/passwd", "demo.mcap", "Demo", "a\0b", "list"]
)
def test_ids_that_could_leave_the_folder_are_refused(folder, name):
    with pytest.raises(RefusedError) as caught:
        existing_file(folder, name)
    assert caught.value.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT


def test_links_out_of_the_folder_are_not_followed(folder):
    (folder / "link.mcap").symlink_to("/etc/passwd")
    with pytest.raises(RefusedError, match=r"There is no recording link\.mcap"):
        read_part(folder, "link", part())


def test_an_unknown_recording_is_not_found(folder):
    with pytest.raises(RefusedError) as caught:
        read_part(folder, "other", part())
    assert caught.value.code == query_pb2.FAULT_CODE_NOT_FOUND


def test_the_pieces_are_the_file(folder):
    data = b""
    while True:
        piece = read_part(folder, "demo", part(offset=len(data), length=700))
        data += piece.data
        if len(data) == piece.total:
            break
    assert hashlib.sha256(data).hexdigest() == describe(folder, "demo").file_hash


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        (part(length=0), "length"),
        (part(length=2**40), "length"),
        (part(offset=2**60), "offset"),
        (part(which="x"), "part"),
    ],
)
def test_pieces_that_are_not_there_are_refused(folder, request_, field):
    with pytest.raises(RefusedError) as caught:
        read_part(folder, "demo", request_)
    assert caught.value.field == field


def test_only_recordings_are_listed(folder):
    (folder / "Not A Recording.mcap").touch()
    (folder / "notes.txt").touch()
    assert recordings_in(folder) == ["demo"]


def test_a_whole_recording_is_found_whole(folder):
    result = verify(folder, "demo")
    assert result.whole
    assert list(result.findings) == []


def test_a_flipped_bit_anywhere_is_found(folder):
    path = folder / "demo.mcap"
    good = path.read_bytes()
    for position in [*range(0, len(good), len(good) // 150), *range(len(good) - 40, len(good), 3)]:
        damaged = bytearray(good)
        damaged[position] ^= 0x10
        path.write_bytes(damaged)
        assert not verify(folder, "demo").whole, position


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_not_whole(folder, share):
    path = folder / "demo.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    assert not verify(folder, "demo").whole
    information = describe(folder, "demo")
    # Nobody writes it. The last two cuts are in its index.
    assert (information.closed, information.ended) == (True, share >= 0.9)
    assert not describe(folder, "demo", waiting="No space left on device").closed
