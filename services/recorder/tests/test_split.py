"""A long recording in several files: without a gap, chained by their hashes, and read as one."""

from __future__ import annotations

import shutil

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import recorder_pb2
from recorder.format import files_of, recording_path
from recorder.log import Archive
from recorder.reading import describe, read_part, read_steps, verify
from recorder.refused import RefusedError

EPOCH = 11
RUNS = 5


@pytest.fixture
def folder(tmp_path, campaign, step_of):
    archive = Archive(tmp_path, split_bytes=12_000, least_free_bytes=0)
    steps = [campaign.specification(), campaign.description(), campaign.model()]
    for number, message in enumerate(steps):
        archive.commit("demo", step_of(number, message))
    number = len(steps)
    for iteration in range(1, RUNS + 1):
        run = f"demo.i{iteration:02d}"
        archive.commit("demo", step_of(number, campaign.planned(run)))
        for seq, block in enumerate(campaign.blocks(run)):
            archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, run), EPOCH, seq, block))
            archive.sync()
        archive.commit("demo", step_of(number + 1, campaign.iteration(iteration, 0.5 / iteration)))
        archive.commit("demo", step_of(number + 2, campaign.played(run, epoch=EPOCH)))
        number += 3
    archive.commit("demo", step_of(number, recorder_pb2.RecordingClosed(reason="done")))
    return tmp_path


def test_the_files_are_one_whole_recording(folder):
    files = files_of(folder, "demo")
    assert len(files) > 3
    result = verify(folder, "demo")
    assert result.whole, result.findings
    information = describe(folder, "demo")
    assert (information.steps, information.signal_blocks, information.missing_blocks) == (4 + 3 * RUNS, 4 * RUNS, 0)
    assert [file.file for file in information.files] == [path.name for path in files]
    assert information.bytes == sum(path.stat().st_size for path in files)
    assert all(file.file_hash for file in information.files)
    assert information.ended
    answer = read_steps(files, recorder_pb2.ReadStepsRequest(), written=None)
    assert [step.step for step in answer.steps] == list(range(4 + 3 * RUNS))


def test_each_file_alone_is_a_complete_mcap_file_with_its_scenario(folder):
    for path in files_of(folder, "demo"):
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            names = {entry.name for entry in reader.iter_metadata()}
            assert names == {"software", "part", "scenario", "summary"}
            for _, channel, _, decoded in reader.iter_decoded_messages():
                if "/signal/" in channel.topic:
                    # Standard tools see numbers: two channels of 50 samples.
                    assert len(decoded.response.data) == 100
                    assert isinstance(decoded.response.data[0], float)


def test_a_file_that_is_lost_is_found_missing(folder):
    files = files_of(folder, "demo")
    files[-1].unlink()
    assert any("with which the recording goes on" in finding for finding in verify(folder, "demo").findings)


def test_a_recording_with_a_file_missing_between_others_is_not_gone_on_with(folder, campaign, step_of):
    last = len(files_of(folder, "demo"))
    recording_path(folder, "demo", number=last - 1).unlink()
    again = Archive(folder, least_free_bytes=0)
    again.recover()
    with pytest.raises(RefusedError, match=rf"part{last:02d}.*part{last - 1:02d}.mcap is missing"):
        again.commit("demo", step_of(0, campaign.specification()))
    recording_path(folder, "demo").unlink()
    with pytest.raises(RefusedError, match=r"demo.mcap is missing"):
        again.commit("demo", step_of(0, campaign.specification()))


def test_a_byte_changed_in_an_early_file_is_found_twice(folder):
    first = files_of(folder, "demo")[0]
    content = bytearray(first.read_bytes())
    content[len(content) // 3] ^= 1
    first.write_bytes(content)
    findings = verify(folder, "demo").findings
    assert any("damaged" in finding for finding in findings)
    assert any("its hash differs" in finding for finding in findings)


def test_every_file_can_be_fetched(folder):
    for number, path in enumerate(files_of(folder, "demo"), start=1):
        request = recorder_pb2.ReadRecordingRequest(length=2**20, part="recording", number=number)
        assert read_part(folder, "demo", request).data == path.read_bytes()


def test_every_file_passes_the_check_of_another_code_base(folder, rerun_program, viewer_environment):
    import subprocess

    for path in files_of(folder, "demo")[:3]:
        done = subprocess.run(
            [rerun_program, "mcap", "check", str(path)],
            env=viewer_environment,
            capture_output=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_kill_right_after_a_split_leaves_a_recording_that_can_be_read_and_gone_on_with(tmp_path, campaign, step_of):
    archive = Archive(tmp_path, split_bytes=6000, least_free_bytes=0)
    for number, message in enumerate([campaign.specification(), campaign.description(), campaign.model()]):
        archive.commit("demo", step_of(number, message))
    archive.sync()
    begun = recording_path(tmp_path, "demo", number=2)
    # As a kill leaves it: before its first bytes, within them, or with nothing but its place in it.
    for kept in (begun.read_bytes(), begun.read_bytes()[:20], b"", None):
        killed = tmp_path / f"killed_{'without' if kept is None else len(kept)}"
        killed.mkdir()
        shutil.copy(recording_path(tmp_path, "demo"), killed)
        if kept is not None:
            (killed / begun.name).write_bytes(kept)
        again = Archive(killed, least_free_bytes=0)
        again.recover()
        assert verify(killed, "demo").findings == ["The last of its 3 steps is not RecordingClosed: it was cut short."]
        again.commit("demo", step_of(3, recorder_pb2.RecordingClosed(reason="done")))
        assert verify(killed, "demo").whole
    archive.close()


def test_a_copy_is_not_gone_on_with_and_is_no_whole_recording(folder, campaign, step_of):
    for name in ("killed", "ended"):
        copied = folder / name
        copied.mkdir()
        content = recording_path(folder, "demo").read_bytes()
        (copied / "backup.mcap").write_bytes(content if name == "ended" else content[: len(content) * 2 // 3])
        archive = Archive(copied, least_free_bytes=0)
        archive.recover()
        with pytest.raises(RefusedError, match="it is a copy of recording 'demo'"):
            archive.commit("backup", step_of(3, campaign.planned("demo.i01")))
        assert "The file backup.mcap is a copy: it says that it belongs to recording 'demo'." in (
            verify(copied, "backup").findings
        )
