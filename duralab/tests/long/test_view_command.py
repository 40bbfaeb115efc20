"""`duralab view`: what a file is, is told by its first bytes; what is neither is refused in one sentence."""

import pytest
import synthetic_campaign
from mcap.writer import Writer
from test_cli import invoke

from duralab.errors import InputError
from duralab.processes import is_recording, rebuilt_view


def foreign(path):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/lidar", "json", writer.register_schema("points", "jsonschema", b"{}"))
        writer.add_message(channel, log_time=0, publish_time=0, data=b"{}")
        writer.finish()
    return path


@pytest.mark.parametrize("name", ["recording.mcap", "live.rrd", "noname"])
def test_the_first_bytes_tell_what_a_file_is(tmp_path, name):
    path = foreign(tmp_path / name)
    assert is_recording(path)
    path.write_bytes(b"RRF2" + bytes(30))
    assert not is_recording(path)


@pytest.mark.parametrize("name", ["x.rrd", "x.mcap", "x"])
@pytest.mark.parametrize("content", [b"", b"hello, I am a text", b"RR", b"\x89MCA"])
def test_what_is_neither_is_refused_before_a_viewer_starts(tmp_path, monkeypatch, name, content):
    def no_viewer(**_):
        raise AssertionError

    monkeypatch.setattr("duralab.processes.Viewer", no_viewer)
    (tmp_path / name).write_bytes(content)
    code, _, error = invoke("view", tmp_path / name)
    assert code == 2
    said = "and is neither a live view nor a recording; give a live.rrd or a recording.mcap."
    assert said in " ".join(error.split())


@pytest.mark.parametrize("name", ["", ".", "none.rrd", "none.mcap", "a" * 300])
def test_a_name_of_no_file_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    code, _, error = invoke("view", name)
    assert code == 2
    assert "give " in error
    assert "recording.mcap." in " ".join(error.split())


def test_the_folder_of_a_campaign_stands_for_its_live_view(tmp_path, monkeypatch):
    shown = []

    def viewer(*, file, **_):
        shown.append(file)
        raise InputError("This is enough.")

    monkeypatch.setattr("duralab.processes.Viewer", viewer)
    (tmp_path / "live.rrd").write_bytes(b"RRF2" + bytes(30))
    foreign(tmp_path / "recording.mcap")
    invoke("view", tmp_path)
    assert shown == [tmp_path / "live.rrd"]


def test_a_foreign_file_is_refused_in_one_sentence_with_one_full_stop(tmp_path):
    path = foreign(tmp_path / "lidar.mcap")
    with pytest.raises(InputError) as caught:
        rebuilt_view(path, tmp_path / "live.rrd", report=print)
    assert str(caught.value) == f"The live view of {path} cannot be made: it holds no message that has a picture."


def test_a_recording_under_another_name_is_made_a_view_of(tmp_path):
    campaign = synthetic_campaign.make(seconds=2.0, iterations=1)
    path = synthetic_campaign.write(tmp_path / "kept.log", synthetic_campaign.steps(campaign))
    assert is_recording(path)
    assert rebuilt_view(path, tmp_path / "live.rrd", report=print).read_bytes().startswith(b"RRF")


def test_a_folder_is_called_one(tmp_path):
    code, _, error = invoke("view", tmp_path)
    assert code == 2
    said = f"{str(tmp_path)!r} is a folder; give the path of a live.rrd or a recording.mcap."
    assert said in " ".join(error.split())


def test_a_recording_that_was_cut_before_its_first_message_has_no_view(tmp_path):
    path = tmp_path / "cut.mcap"
    content = foreign(tmp_path / "whole.mcap").read_bytes()
    # The header's record, whole; then opcode and length of the next, and two of its bytes.
    header = 8 + 9 + int.from_bytes(content[9:17], "little")
    path.write_bytes(content[: header + 9 + 2])
    told = []
    with pytest.raises(InputError) as caught:
        rebuilt_view(path, tmp_path / "live.rrd", report=told.append)
    assert str(caught.value) == f"The live view of {path} cannot be made: it holds no message that has a picture."
    assert told == [f"{path} was never finished; it is shown as far as it is whole."]
