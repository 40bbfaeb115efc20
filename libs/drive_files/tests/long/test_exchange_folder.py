"""Outbox and inbox: what is written is whole, what is taken is the response of this drive, all else has its reason."""

import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from exchanges import MAP, MIX, RATE, beam_map, gentle, recorded, save

from duralab_drive_files import DataType, DriveFileError, Inbox, Outbox, inbox, judged, outbox, read_order, read_rpc3


@pytest.fixture
def beam(tmp_path):
    return beam_map(tmp_path)


@pytest.fixture
def box(beam):
    box = Outbox(beam)
    yield box
    box.close()


def error_of(found, wanted):
    return np.sqrt(((found - wanted) ** 2).sum(axis=1) / (wanted**2).sum(axis=1)).max()


def test_the_drive_file_is_the_drive_with_its_leads_at_full_scale(beam, box):
    drive = gentle() + np.array([[0.01], [1000.0]])
    order = box.put("one", drive, seed=3)
    folder = beam.exchange / "outbox"
    assert sorted(path.name for path in folder.iterdir()) == ["done", "one.drv", "one.html", "one.json"]
    assert read_order(folder / "one.json") == order == box.waiting()
    history = read_rpc3(folder / "one.drv")
    assert (history.names, history.units, history.sample_rate) == (("Lift", "Push"), ("mm", "kN"), 512.0)
    assert history.samples.shape[1] == order.samples
    # Leads of half a second, and a step of 16 bits over the range, not the peak.
    assert order.lead_samples == 256
    assert np.abs(history.samples[:, 0]).max() < 1e-3
    assert [channel.full_scale for channel in order.channels] == [100.0, 20.0]
    assert history.samples[0, 256] == pytest.approx(-1000.0 * drive[0, 0], abs=0.02)
    told = json.loads((folder / "one.json").read_text())
    assert told["sha256"] == outbox.file_hash(folder / "one.drv")
    assert told["recorded_commands"] == {"Lift": "Lift Cmd", "Push": "Push Cmd"}
    assert told["wanted_channels"] == ["Lift Cmd", "Push Cmd", "SG 1", "Load"]
    page = (folder / "one.html").read_text()
    assert order.sha256 in page
    assert "inbox/one.refuse.txt" in page


def test_a_controller_with_an_offset_gets_no_leads(tmp_path):
    beam = beam_map(tmp_path, f"{MAP}drive_has_offset: true\n")
    box = Outbox(beam)
    drive = gentle() + 0.01
    order = box.put("one", drive)
    assert order.lead_samples == 0
    assert order.drive_has_offset
    assert read_rpc3(beam.exchange / "outbox" / "one.drv").samples[0, 0] == pytest.approx(
        -1000.0 * drive[0, 0], abs=0.01
    )
    box.close()


@pytest.mark.parametrize("numbers", list(DataType))
@pytest.mark.parametrize("rate", [500.0, 512.0, 1024.0, 2048.0, 400.0])
def test_a_late_response_of_another_rate_is_the_truth_within_a_thousandth(beam, box, rate, numbers):
    drive = gentle()
    order = box.put("one", drive)
    path = save(beam, order, recorded(beam, order, rate=rate), data_type=numbers)
    found = judged(beam, order, drive, path)
    assert error_of(found.response, MIX @ (1.005 * drive)) < 1e-3
    assert found.alignment.lag == pytest.approx(37.4, abs=1e-2)
    assert found.alignment.gain == pytest.approx([1.005, 1.005], abs=2e-4)
    assert found.alignment.offset == pytest.approx([0.0, 0.0], abs=2.0)
    assert bool(found.remarks) == (rate < RATE)


def swapped(rows):
    return rows[::-1] * np.array([[0.05 / 10000.0], [10000.0 / 0.05]])


def broken_off(rows):
    rows = rows.copy()
    rows[:, 1500:] = 0.0
    return rows


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ({"gain": 0.8}, r"80\.\d % of the drive's size"),
        ({"change": swapped}, "the command of lift follows push"),
        ({"change": lambda rows: rows * [[-1.0], [1.0]]}, "the command of lift is inverted"),
        ({"change": broken_off}, "broken off"),
        ({"end": 3.0}, "save its last frame"),
        ({"ppm": 100.0}, "let one clock drive output and acquisition"),
        ({"rate": 200.0}, "its sample rate is 200 Hz"),
        ({"change": lambda rows: np.add(rows, [[0.005], [0.0]])}, "is off by 5.0 % of its limit"),
    ],
)
def test_what_is_not_this_drive_is_refused_with_the_reason(beam, box, fault, sentence):
    drive = gentle(seconds=8.0)
    order = box.put("one", drive)
    path = save(beam, order, recorded(beam, order, **fault))
    with pytest.raises(DriveFileError, match=sentence):
        judged(beam, order, drive, path)


def test_the_response_of_another_drive_is_refused(beam, box):
    order = box.put("one", gentle(seed=1))
    path = save(beam, order, recorded(beam, order))
    with pytest.raises(DriveFileError, match="record of another run"):
        judged(beam, order, gentle(seed=2), path)


def test_missing_channels_are_named(beam, box):
    drive = gentle()
    order = box.put("one", drive)
    whole = recorded(beam, order)
    for row, named in ((3, "lacks the channels Load"), (1, "lacks the recorded commands Push Cmd")):
        kept = [index for index in range(4) if index != row]
        less = replace(
            whole,
            names=tuple(whole.names[index] for index in kept),
            units=tuple(whole.units[index] for index in kept),
            samples=whole.samples[kept],
        )
        with pytest.raises(DriveFileError, match=named):
            judged(beam, order, drive, save(beam, order, less))


def test_without_recorded_commands_the_missing_check_is_said(tmp_path):
    text = re.sub(r",\s+recorded_command: \w+ Cmd", "", MAP)
    beam = beam_map(tmp_path, text)
    box, drive = Outbox(beam), gentle()
    order = box.put("one", drive)
    history = recorded(beam, replace(order, wanted_channels=("a", "b", *order.wanted_channels)), delay=0.0, gain=1.0)
    found = judged(beam, order, drive, save(beam, order, history))
    assert found.alignment is None
    assert "No command was recorded of lift, push" in found.remarks[0]
    assert error_of(found.response, MIX @ drive) < 1e-3
    box.close()


def test_a_drive_at_rest_is_taken_from_its_place(beam, box):
    drive = np.zeros((2, 1000))
    order = box.put("one", drive)
    found = judged(beam, order, drive, save(beam, order, recorded(beam, order)))
    assert found.alignment is None
    assert found.remarks == ("No drive moves: the response is taken from where the drive lies in the file.",)
    assert np.abs(found.response).max() < 1e-3
    moving = recorded(beam, order)
    moving.samples[0, 900] = 5.0
    with pytest.raises(DriveFileError, match="the command of lift moves"):
        judged(beam, order, drive, save(beam, order, moving))


def test_a_refused_file_stays_with_its_reason_and_a_better_one_is_taken(beam, box):
    drive, taken = gentle(), Inbox(box, stable_seconds=0.0)
    order = box.put("one", drive)
    assert taken.take(order, drive) is None
    good = recorded(beam, order)
    path = save(beam, order, good)
    content = path.read_bytes()
    path.write_bytes(content[:-100])
    assert taken.take(order, drive) is None
    reason = path.with_name("one.rsp.refused.txt")
    assert "the file ends here" in taken.refusal
    assert reason.read_text() == f"{taken.refusal}\n"
    assert path.exists()
    for moved, said in ((7200.0, "in the future"), (-7200.0, "older than its drive")):
        path.write_bytes(content)
        os.utime(path, (time.time() + moved,) * 2)
        assert taken.take(order, drive) is None
        assert said in taken.refusal
    path.write_bytes(content)
    accepted = taken.take(order, drive)
    assert accepted is not None
    assert not reason.exists()
    box.end(order, "answered", response_sha256=accepted.sha256)
    assert box.waiting() is None
    assert [order.response_sha256 for order in box.ended()] == [accepted.sha256]
    assert list((beam.exchange / "inbox").iterdir()) == []
    # The very file again, for the next run with the same drive.
    second = box.put("two", drive)
    (beam.exchange / "inbox" / "two.rsp").write_bytes(content)
    assert taken.take(second, drive) is None
    assert "it is the response of run 'one'" in taken.refusal


def test_a_file_that_is_still_written_is_left_alone(beam, box, monkeypatch):
    drive, taken = gentle(), Inbox(box)
    order = box.put("one", drive)
    now = [0.0]
    monkeypatch.setattr(inbox.time, "monotonic", lambda: now[0])
    path = save(beam, order, recorded(beam, order))
    content = path.read_bytes()
    for part in (2, 1):
        path.write_bytes(content[: len(content) // part])
        assert taken.take(order, drive) is None
        now[0] += 0.4
        assert taken.take(order, drive) is None
        assert taken.refusal == ""
    now[0] += 0.6
    assert taken.take(order, drive) is not None


def test_a_person_refuses(beam, box):
    order = box.put("one", gentle())
    taken = Inbox(box)
    assert taken.refusal_by_person(order) == ""
    (beam.exchange / "inbox" / "one.refuse.txt").write_text("not\n clamped ")
    assert taken.refusal_by_person(order) == "not clamped"


def test_one_order_waits_and_a_name_is_used_once(box):
    order = box.put("one", gentle())
    with pytest.raises(DriveFileError, match=r"run 'one' waits for its response; play one\.drv"):
        box.put("two", gentle())
    box.end(order, "stopped")
    with pytest.raises(DriveFileError, match="give every run its own name"):
        box.put("one", gentle())


def test_a_full_disk_leaves_no_order_and_one_sentence(beam, box, monkeypatch):
    def full(path, text):
        path.write_text(text[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(outbox, "write_text", full)
    with pytest.raises(DriveFileError, match=r"it cannot be written .*No space left.*free the disk"):
        box.put("one", gentle())
    assert [path.name for path in (beam.exchange / "outbox").iterdir()] == ["done"]
    assert box.waiting() is None


def test_a_drive_beyond_the_range_is_no_order(beam, box):
    with pytest.raises(DriveFileError, match="lower the drive"):
        box.put("one", 3.0 * gentle())
    assert [path.name for path in (beam.exchange / "outbox").iterdir()] == ["done"]


def test_a_folder_that_is_a_file_is_said(beam):
    beam.exchange.write_text("")
    with pytest.raises(DriveFileError, match="it cannot be written"):
        Outbox(beam)


def test_a_second_gateway_is_refused(beam, box, tmp_path):
    script = (
        "import sys\nfrom pathlib import Path\n"
        "from duralab_drive_files import DriveFileError, Outbox, read_controller_map\n"
        "try:\n    Outbox(read_controller_map(Path(sys.argv[1])))\n"
        "except DriveFileError as error:\n    print(error.sentence)\n"
    )
    asked = [sys.executable, "-c", script, str(tmp_path / "beam.yaml")]
    said = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=60)
    assert said.stdout.startswith("another gateway uses this exchange folder")


def test_an_order_that_somebody_changed_is_said(beam, box):
    box.put("one", gentle())
    (beam.exchange / "outbox" / "one.json").write_text("{}")
    with pytest.raises(DriveFileError, match="no order of a drive"):
        box.waiting()
