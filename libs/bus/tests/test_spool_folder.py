"""Spools on disk: they survive their process, are bounded, and are deleted when they are marked."""

import subprocess
import sys
import time
import tracemalloc

import pytest

import duralab_bus
from duralab_bus.spool import folder as spool_folder
from duralab_bus.spool.spool import Spool, SpoolFullError

PAYLOAD = bytes(range(256)) * 40

KILLED = """
import os, signal, sys
from pathlib import Path
import duralab_bus
from duralab_bus.spool.spool import Spool
spools = duralab_bus.SpoolFolder(Path(sys.argv[1]))
for epoch, count in ((5, 1000), (6, 3)):
    spool = Spool(spools.store(key=f"k/{epoch}", epoch=epoch), held=True, unheld_bytes=0)
    for number in range(count):
        spool.append(number.to_bytes(4, "big") + bytes(10000), "text")
    if epoch == 5:
        spool.mark(int(sys.argv[2]))
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def killed(tmp_path):
    """A folder that a process left behind when it was killed, with 1000 and 3 messages, 500 of them marked."""
    ran = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), "500"], check=False, timeout=120)
    assert ran.returncode == -9
    return tmp_path


def spool_in(folder, *, held=True, unheld_bytes=0, epoch=1):
    return Spool(folder.store(key="k", epoch=epoch), held=held, unheld_bytes=unheld_bytes)


def fill(spool, count):
    for number in range(count):
        spool.append(number.to_bytes(4, "big") + PAYLOAD, "text")


def test_what_was_written_is_read_back_wherever_it_lies(tmp_path):
    spool = spool_in(duralab_bus.SpoolFolder(tmp_path))
    fill(spool, 1000)
    assert len(list(tmp_path.glob("*/*.spool"))) > 2
    read = spool.read(390, 900, most=400)
    assert [message.seq for message in read] == list(range(390, 790))
    assert all(message.payload == message.seq.to_bytes(4, "big") + PAYLOAD for message in read)
    assert {message.encoding for message in read} == {"text"}


def test_killed_process_leaves_every_message_that_is_not_marked(killed):
    spools = duralab_bus.SpoolFolder(killed)
    left = {(one.key, one.epoch): one.spool for one in spools.take_over()}
    assert set(left) == {("k/5", 5), ("k/6", 6)}
    extent = left["k/5", 5].extent
    # Whole segments are deleted: a few that were marked may still be there.
    assert extent.first <= 500 < extent.first + 500
    assert extent.next == 1000
    messages = left["k/5", 5].read(extent.first, 1000, most=1000)
    assert [int.from_bytes(message.payload[:4], "big") for message in messages] == list(range(extent.first, 1000))
    for spool in left.values():
        spool.mark(1000)
        assert spool.settled
        spool.close(delete=False)
    spools.close()
    assert list(killed.iterdir()) == []


def test_segments_that_are_written_again_show_nothing_of_what_they_held(tmp_path):
    spools = duralab_bus.SpoolFolder(tmp_path)
    spool = spool_in(spools, epoch=7)
    segments = set()
    for number in range(20):
        fill(spool, 100)
        spool.mark(100 * number + 50)
        segments |= {path.stat().st_ino for path in tmp_path.glob("*/*")}
    # 2000 messages of 10 KB would have taken more than these, had none been used twice.
    assert len(segments) <= 5
    content = {path.name: path.read_bytes() for path in tmp_path.glob("*/7-*.spool")}
    left = tmp_path / "of the dead"
    left.mkdir()
    for name, written in content.items():
        (left / name).write_bytes(written)
    (taken,) = (one.spool for one in duralab_bus.SpoolFolder(tmp_path).take_over())
    extent = taken.extent
    assert extent.first <= 1950
    assert extent.next == 2000
    read = taken.read(extent.first, extent.next, most=2000)
    assert [int.from_bytes(message.payload[:4], "big") for message in read] == [
        seq % 100 for seq in range(extent.first, 2000)
    ]


def test_spool_that_nobody_marks_now_is_there_at_the_next_start_again(killed):
    first = duralab_bus.SpoolFolder(killed)
    for left in first.take_over():
        left.spool.close(delete=False)
    first.close()
    assert {left.epoch for left in duralab_bus.SpoolFolder(killed).take_over()} == {5, 6}


def test_segments_are_taken_over_without_a_copy_of_what_follows_each_message(tmp_path):
    store = duralab_bus.SpoolFolder(tmp_path / "written").store(key="k", epoch=1)
    spool = Spool(store, held=True, unheld_bytes=0)
    fill(spool, 100)
    (path,) = tmp_path.glob("written/*/1-*.spool")
    content = path.read_bytes()
    space = duralab_bus.SpoolFolder(tmp_path / "taking")
    taking = spool_folder._DiskStore(space, space.path, key="k", epoch=1, writable=False)
    tracemalloc.start()
    try:
        taking.adopt(path, 0, content)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert taking.adopted == range(100)
    # One message is read at a time, and copied once or twice.
    assert most < 10 * len(PAYLOAD) < len(content) // 10


def test_spool_of_a_process_that_lives_is_not_taken(killed):
    holder = duralab_bus.SpoolFolder(killed)
    taken = holder.take_over()
    assert len(taken) == 2
    other = "import pathlib, sys; from duralab_bus import SpoolFolder; "
    other += "print(len(SpoolFolder(pathlib.Path(sys.argv[1])).take_over()))"
    ran = subprocess.run([sys.executable, "-c", other, str(killed)], check=True, capture_output=True, text=True)
    assert ran.stdout.strip() == "0"


def test_damaged_message_ends_what_is_taken_over(killed):
    segment = min(path for path in killed.glob("*/5-*.spool"))
    content = bytearray(segment.read_bytes())
    content[100_000] ^= 1
    segment.write_bytes(content)
    (left,) = (one.spool for one in duralab_bus.SpoolFolder(killed).take_over() if one.epoch == 5)
    extent = left.extent
    # Message 9 of the segment lies there.
    assert extent.next - extent.first == 9
    assert len(left.read(extent.first, extent.next, most=100)) == 9


def test_strange_files_are_left_alone(tmp_path):
    (tmp_path / "old").mkdir()
    for name, content in (("1-0.spool", b""), ("2-x.spool", b"DURASPL3"), ("readme.txt", b"text")):
        (tmp_path / "old" / name).write_bytes(content)
    spools = duralab_bus.SpoolFolder(tmp_path)
    assert spools.take_over() == []
    spools.close()
    assert {path.name for path in (tmp_path / "old").iterdir()} >= {"1-0.spool", "2-x.spool", "readme.txt"}


def test_folder_is_bounded_and_says_when_it_is_full(tmp_path):
    spools = duralab_bus.SpoolFolder(tmp_path, largest_bytes=24 * 2**20)
    spool = spool_in(spools)
    while not spool.shortage:
        fill(spool, 1)
    assert "the spool of 24 MiB" in spool.shortage
    # What must still be put in has its place.
    fill(spool, 100)
    with pytest.raises(SpoolFullError, match="not stored"):
        fill(spool, 10_000)
    kept = spool.extent
    assert kept.first == 0
    assert sum(path.stat().st_size for path in tmp_path.glob("*/*")) <= 28 * 2**20
    spool.mark(kept.next)
    assert not spool.shortage
    assert sum(path.stat().st_size for path in tmp_path.glob("*/*")) <= 8 * 2**20


def test_disk_that_is_full_is_known_while_there_is_room_for_the_end(tmp_path, monkeypatch):
    spool = spool_in(duralab_bus.SpoolFolder(tmp_path))

    def refuse(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spool_folder.os, "posix_fallocate", refuse)
    while not spool.shortage:
        fill(spool, 1)
    assert "No space left" in spool.shortage
    fill(spool, 300)
    with pytest.raises(SpoolFullError, match="No space left"):
        fill(spool, 1000)
    monkeypatch.undo()
    assert not spool.shortage
    written = spool.extent.next
    fill(spool, 10)
    assert [message.seq for message in spool.read(0, written + 10, most=10_000)] == list(range(written + 10))


def test_message_larger_than_a_segment_is_kept(tmp_path):
    spool = spool_in(duralab_bus.SpoolFolder(tmp_path))
    sizes = [10, 5 * 2**20, 20]
    for size in sizes:
        spool.append(bytes(size), "text")
    assert [len(message.payload) for message in spool.read(0, 3, most=3)] == sizes


def test_oldest_segments_give_way_where_nobody_marks(tmp_path):
    spool = spool_in(duralab_bus.SpoolFolder(tmp_path), held=False, unheld_bytes=8 * 2**20)
    fill(spool, 3000)
    extent = spool.extent
    assert extent.next == 3000
    assert 0 < extent.first < 3000
    assert [message.seq for message in spool.read(0, 3000, most=5000)] == list(range(extent.first, 3000))
    assert sum(path.stat().st_size for path in tmp_path.glob("*/*")) <= 16 * 2**20
    spool.close(delete=False)
    assert list(tmp_path.glob("*/*.spool")) == []


@pytest.mark.parametrize("size", [0, 2**20])
def test_folder_that_is_too_small_is_refused(tmp_path, size):
    with pytest.raises(duralab_bus.BusError, match="too small"):
        duralab_bus.SpoolFolder(tmp_path, largest_bytes=size)


def test_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(duralab_bus.BusError, match="No spool can be kept"):
        duralab_bus.SpoolFolder(tmp_path / "file")


def test_two_folders_made_at_once_are_apart(tmp_path):
    first = duralab_bus.SpoolFolder(tmp_path)
    time.sleep(0.001)
    second = duralab_bus.SpoolFolder(tmp_path)
    assert first.path != second.path
    first.close()
    assert not first.path.exists()
    assert second.path.exists()
