"""The exchange folder on a disk that is full or read-only: no order, nothing half written, and the rig stays usable."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from file_lab import MAP, WAIT, Controller, FileLab, gentle, until

from duralab_bus import FaultError
from duralab_drive_files import DriveFileError, Outbox, read_controller_map
from duralab_proto.v1 import rig_pb2

SIZE = 4 * 1024 * 1024


@pytest.fixture
def disk(mount_disk):
    """An exchange folder that is a file system of 4 MiB."""
    return mount_disk("exchange", SIZE)


def fill(folder, *, free_pages=0, name="filler"):
    """Take all of the disk but some pages, as another program does."""
    free = os.statvfs(folder)
    (folder / name).write_bytes(b"\1" * ((free.f_bavail - free_pages) * free.f_frsize))


@contextmanager
def read_only(folder):
    """Lay a read-only view of a folder over it: the whole disk has files open."""
    subprocess.run(["mount", "--bind", str(folder), str(folder)], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,bind,ro", str(folder)], check=True)
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def left(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def attempted(outbox, disk, *, free_pages):
    fill(disk, free_pages=free_pages)
    try:
        return outbox.put("one", gentle())
    except DriveFileError as error:
        said = error.sentence
    assert said.startswith("it cannot be written (No space left on device); free the disk")
    return None


def test_wherever_the_disk_gets_full_nothing_half_written_stays(disk, tmp_path):
    (tmp_path / "beam.yaml").write_text(MAP)
    outbox, refused = Outbox(read_controller_map(tmp_path / "beam.yaml")), 0
    # The drive file takes some pages, the page for the operator and the order one each.
    while (order := attempted(outbox, disk, free_pages=refused)) is None:
        assert left(disk) == [".lock", "filler"]
        (disk / "filler").unlink()
        refused += 1
    assert refused > 3
    # Its end needs a page too.
    fill(disk, name="rest")
    with pytest.raises(DriveFileError, match="No space left on device"):
        outbox.end(order, "answered")
    assert left(disk / "outbox") == ["one.drv", "one.html", "one.json"]
    (disk / "rest").unlink()
    (disk / "filler").unlink()
    assert outbox.waiting() == order
    outbox.end(order, "answered")
    outbox.close()


@pytest.fixture
def lab(disk, tmp_path):
    lab = FileLab(tmp_path)
    lab.start()
    yield lab
    lab.close()


def test_a_rig_goes_on_once_its_full_disk_has_room(lab, disk):
    drive = gentle(seed=1)
    fill(disk)
    with pytest.raises(FaultError, match=r"it cannot be written \(No space left on device\)") as refused:
        lab.play("full", drive)
    assert refused.value.code_name == "FAILED_PRECONDITION"
    assert lab.state().mode == rig_pb2.RIG_MODE_IDLE
    assert left(disk) == [".lock", "filler"]
    (disk / "filler").unlink()
    with Controller(lab.map).running() as controller:
        lab.play("room", drive)
        assert controller.played == ["room"]


def test_a_response_that_came_before_the_disk_was_full_is_taken_afterwards(lab, disk):
    drive = gentle(seed=2)
    controller = Controller(lab.map)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(lab.play, "one", drive)
        lab.waits()
        lab.end(kill=True)
        with pytest.raises(FaultError):
            asked.result(WAIT)
    with controller.running():
        until((lab.inbox / "one.rsp").exists)
    fill(disk)
    lab.start()
    with pytest.raises(FaultError, match="No space left on device"):
        lab.play("one-2", drive)
    assert lab.state().mode == rig_pb2.RIG_MODE_IDLE
    assert [path.name for path in (lab.outbox / "done").iterdir()] == []
    (disk / "filler").unlink()
    lab.play("one-3", drive)
    assert controller.played == ["one"]


def test_a_read_only_folder_is_said_and_the_rig_goes_on_afterwards(lab, disk):
    drive = gentle(seed=3)
    with read_only(lab.outbox):
        with pytest.raises(FaultError, match=r"it cannot be written \(Read-only file system\).*correct its rights"):
            lab.play("shut", drive)
        assert lab.state().mode == rig_pb2.RIG_MODE_IDLE
    assert left(disk) == [".lock"]
    with Controller(lab.map).running() as controller:
        lab.play("open", drive)
        assert controller.played == ["open"]


def test_a_gateway_does_not_start_on_a_read_only_folder(disk, tmp_path):
    lab = FileLab(tmp_path)
    asked = [sys.executable, "-m", "file_rig", "--config", str(lab.config)]
    with (
        read_only(disk),
        subprocess.Popen(asked, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
    ):
        assert process.wait(WAIT) == 2
        assert "it cannot be written (Read-only file system)" in process.stderr.read()
    lab.bus.close()
