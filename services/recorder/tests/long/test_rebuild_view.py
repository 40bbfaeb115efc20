"""The live view made again from a log: of whole files, and what is said of others."""

from __future__ import annotations

import subprocess
import sys

import pytest

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import recorder_pb2
from duralab_recordings import scan
from recorder import rebuild_view
from recorder.live import LiveViews
from recorder.log import Archive

RUN = "demo.i01"


@pytest.fixture
def log(tmp_path, campaign, step_of):
    """Return the file of a recording with a playback."""
    archive = Archive(tmp_path, least_free_bytes=0)
    steps = [campaign.specification(), campaign.description(), campaign.target_in_band(), campaign.planned(RUN)]
    for number, message in enumerate(steps):
        archive.commit("demo", step_of(number, message))
    for seq, block in enumerate(campaign.blocks(RUN)):
        archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, seq, block))
        # Each in a chunk of its own.
        archive.sync()
    archive.commit("demo", step_of(4, campaign.iteration(1, 0.1)))
    archive.commit("demo", step_of(5, recorder_pb2.RecordingClosed(reason="done")))
    return tmp_path / "demo.mcap"


def made_again(log, capsys):
    """Return the exit code, what is said, and whether there is a view."""
    out = log.with_name("again.rrd")
    code = rebuild_view.main([str(log), "--out", str(out)])
    return code, capsys.readouterr().err, out.exists()


def is_sentence(said):
    return said.count("\n") == 1 and said.endswith(".\n")


def test_the_view_of_a_whole_log_is_made_in_silence(log, capsys):
    assert made_again(log, capsys) == (0, "", True)


def test_a_view_needs_no_pandas(log, tmp_path):
    out = tmp_path / "again.rrd"
    program = f"""
import sys
from recorder.live import leave_out_pandas
leave_out_pandas()
from recorder import rebuild_view
print(rebuild_view.main([{str(log)!r}, "--out", {str(out)!r}]), "pandas" in sys.modules)
"""
    # What Rerun cannot take it leaves out, with a warning.
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0 False\n", "")
    assert out.exists()


def test_a_flipped_bit_anywhere_leaves_no_view(log, capsys):
    good = log.read_bytes()
    end = scan(log, lambda _: None).end
    for position in [*range(0, end, end // 60), end - 1]:
        damaged = bytearray(good)
        damaged[position] ^= 0x10
        log.write_bytes(damaged)
        code, said, there = made_again(log, capsys)
        assert (code, there) == (1, False), position
        assert is_sentence(said)


def test_damage_within_signals_is_told_with_its_place_and_what_to_do(log, campaign, capsys):
    damaged = bytearray(log.read_bytes())
    # Noise in float64 is packed as it is.
    damaged[damaged.index(campaign.blocks(RUN)[2].response.data[:16]) + 3] ^= 0x10
    log.write_bytes(damaged)
    code, said, _ = made_again(log, capsys)
    assert code == 1
    # Specification, description, target and two blocks.
    assert said.startswith(f"The recording {log} cannot be shown: demo.mcap is damaged after 5 of the messages")
    assert "`verify` of the recorder says more" in said


@pytest.mark.parametrize("share", [0.7, 0.95, 0.999])
def test_a_file_that_was_cut_off_is_shown_as_far_as_it_goes_and_told_of(log, capsys, share):
    data = log.read_bytes()
    log.write_bytes(data[: int(len(data) * share)])
    code, said, there = made_again(log, capsys)
    assert (code, there) == (0, True)
    assert is_sentence(said)
    assert said.startswith(f"The file {log} has no end and is shown as far as it is whole")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "demo.mcap cannot be read (No such file or directory); give"),
        (b"", "it holds no message that has a picture."),
        (b"hello", "demo.mcap is no recording, it does not begin as an MCAP file; give"),
        (b"hello, this is no recording", "demo.mcap is no recording, it does not begin as an MCAP file; give"),
    ],
)
def test_what_is_no_recording_is_told_in_a_sentence(tmp_path, capsys, content, told):
    log = tmp_path / "demo.mcap"
    if content is not None:
        log.write_bytes(content)
    code, said, there = made_again(log, capsys)
    assert (code, there) == (1, False)
    assert is_sentence(said)
    assert told in said


def test_a_view_that_cannot_be_written_is_told(log, capsys):
    assert rebuild_view.main([str(log), "--out", str(log.parent / "nowhere" / "again.rrd")]) == 1
    assert "again.rrd cannot be written" in capsys.readouterr().err


def test_damage_in_the_log_costs_the_view_of_what_goes_on_only_what_is_damaged(log, campaign):
    damaged = bytearray(log.read_bytes())
    damaged[damaged.index(campaign.blocks(RUN)[2].response.data[:16]) + 3] ^= 0x10
    log.write_bytes(damaged)
    live = log.with_suffix(".rrd")
    live.write_bytes(b"what the recorder showed before it was killed")
    views = LiveViews(log.parent, files=True, viewer=None)
    views.show_step("demo", campaign.iteration(4, 0.05))
    views.finish("demo")
    views.close(10.0)
    assert b"iteration 04" in live.read_bytes().replace(b"\\ ", b" ")
