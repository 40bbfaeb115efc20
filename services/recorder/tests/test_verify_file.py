"""What is wrong with a recording, said as it is: also of files in no recorder's folder."""

from __future__ import annotations

import json
import os
import re
import shutil

import pytest

from duralab_proto.v1 import recorder_pb2
from recorder import rebuild_view, verify_file
from recorder.log import Archive


@pytest.fixture
def recording(tmp_path, campaign, step_of):
    """A recording of several files under the names that they have where they were copied to."""
    archive = Archive(tmp_path, split_bytes=6000, least_free_bytes=0)
    messages = [campaign.specification(), campaign.description(), campaign.model(), campaign.planned("demo.i01")]
    for number, message in enumerate([*messages, recorder_pb2.RecordingClosed(reason="done")]):
        archive.commit("demo", step_of(number, message))
        archive.sync()
    copied = tmp_path / "out"
    copied.mkdir()
    for path in tmp_path.glob("demo*.mcap"):
        shutil.copy(path, copied / path.name.replace("demo", "recording"))
    assert len(list(copied.iterdir())) > 1
    return copied / "recording.mcap"


@pytest.fixture
def findings(recording, capsys):
    def read():
        assert verify_file.main([str(recording)]) == 0
        return json.loads(capsys.readouterr().out)

    return read


def test_files_that_were_copied_are_whole_under_any_name(findings):
    assert findings() == []


def test_damage_is_not_said_to_be_a_recording_cut_short(recording, findings):
    last = max(recording.parent.iterdir())
    content = bytearray(last.read_bytes())
    content[len(content) // 3] ^= 1
    last.write_bytes(content)
    found = findings()
    assert last.name in found[0]
    assert any(re.fullmatch(r"What follows, if anything does, was not read; \d steps lie .*", line) for line in found)
    assert not any("cut short" in finding for finding in found)


def test_zeros_in_the_place_of_a_record_are_told_at_once(recording, findings):
    last = max(recording.parent.iterdir())
    first_chunk = last.read_bytes().index(b"\x06", 300)
    os.truncate(last, first_chunk)
    os.truncate(last, 2**31)
    assert any("zeros where a record was to come" in finding for finding in findings())


def test_bytes_after_the_end_are_told(recording, findings):
    last = max(recording.parent.iterdir())
    os.truncate(last, last.stat().st_size + 2**31)
    assert findings() == [f"The file {last.name} has {2**31} bytes after its end."]


def test_a_fifo_is_refused_and_makes_nobody_wait(tmp_path, capsys):
    fifo = tmp_path / "r.mcap"
    os.mkfifo(fifo)
    assert verify_file.main([str(fifo)]) == 1
    assert rebuild_view.main([str(fifo), "--out", str(tmp_path / "r.rrd")]) == 1
    assert capsys.readouterr().err.count("it is no regular file") == 2


def test_damage_at_the_end_is_told_of_the_end(recording, findings):
    last = max(recording.parent.iterdir())
    last.write_bytes(last.read_bytes()[:-1] + b"\0")
    found = findings()
    assert len(found) == 1
    assert found[0].endswith("it does not end as an MCAP file.")


def test_what_is_no_file_is_one_sentence(tmp_path, capsys):
    assert verify_file.main([str(tmp_path)]) == 1
    assert capsys.readouterr().err == f"The recording {tmp_path} cannot be read: Is a directory.\n"
