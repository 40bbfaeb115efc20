"""A recorder that was killed: what it acknowledged is there, its files become whole, and the recording goes on."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from duralab_bus import Continuity, StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2
from duralab_recordings import MAGIC, is_begun, is_finished
from recorder.format import DAMAGED_FOLDER, Summary, files_of, read_summary, recordings_in
from recorder.log import Archive, Placement
from recorder.reading import describe, verify
from recorder.refused import RefusedError

EPOCH = 11


def blocks_of(campaign, run="demo.i01"):
    key = Keys().rig_signal(campaign.rig, run)
    return [StreamItem(key, EPOCH, seq, block) for seq, block in enumerate(campaign.blocks(run))]


@pytest.fixture
def begin(campaign, step_of):
    """Begin recordings; who is killed in a test closes its files when the test is over."""
    archives = []

    def begin_in(folder):
        archives.append(begun(folder, campaign, step_of))
        return archives[-1]

    yield begin_in
    for archive in archives:
        archive.close()


def begun(folder, campaign, step_of):
    """Commit up to a playback of which three of four blocks are here."""
    archive = Archive(folder, least_free_bytes=0)
    for number, message in enumerate(
        [campaign.specification(), campaign.description(), campaign.model(), campaign.planned("demo.i01")]
    ):
        archive.commit("demo", step_of(number, message))
    for item in blocks_of(campaign)[:3]:
        archive.take_block(item)
    archive.sync()
    return archive


def killed(folder, to):
    """Return a folder as a killed recorder leaves it: the files as they lie there now."""
    to.mkdir()
    for path in folder.glob("*.mcap"):
        shutil.copy(path, to / path.name)
    return to


def go_on(folder, campaign, step_of):
    archive = Archive(folder, least_free_bytes=0)
    archive.recover()
    # As after a restart: the publisher sends everything again that was not marked.
    for item in blocks_of(campaign):
        archive.take_block(item)
    archive.commit("demo", step_of(4, campaign.played("demo.i01", epoch=EPOCH)))
    archive.commit("demo", step_of(5, campaign.iteration(1, 0.5)))
    archive.commit("demo", step_of(6, recorder_pb2.RecordingClosed(reason="done")))
    return archive


def test_a_killed_recording_goes_on_and_is_whole(begin, tmp_path, campaign, step_of):
    begin(tmp_path)
    folder = killed(tmp_path, tmp_path / "after")
    left = (folder / "demo.mcap").read_bytes()
    go_on(folder, campaign, step_of)
    result = verify(folder, "demo")
    assert result.whole, result.findings
    assert [path.name for path in files_of(folder, "demo")] == ["demo.mcap", "demo.part02.mcap"]
    information = describe(folder, "demo")
    assert (information.steps, information.signal_blocks, information.missing_blocks) == (7, 4, 0)
    assert (folder / DAMAGED_FOLDER / "demo.mcap").read_bytes() == left
    # Nothing is written twice: what was written stays where it is.
    assert (folder / "demo.mcap").read_bytes().startswith(left)


def test_a_fifo_in_the_folder_is_no_recording(tmp_path):
    os.mkfifo(tmp_path / "demo.mcap")
    Archive(tmp_path, least_free_bytes=0).recover()
    assert recordings_in(tmp_path) == []


def test_wherever_it_was_cut_off_what_is_there_is_kept_and_the_rest_comes_again(begin, tmp_path, campaign, step_of):
    begin(tmp_path)
    content = (tmp_path / "demo.mcap").read_bytes()
    chosen = random.Random(6)
    for place in [0, 3, 8, 30, len(content), *(chosen.randrange(len(content)) for _ in range(4))]:
        folder = tmp_path / f"cut{place}"
        folder.mkdir(exist_ok=True)
        (folder / "demo.mcap").write_bytes(content[:place])
        archive = Archive(folder, least_free_bytes=0)
        archive.recover()
        messages = [campaign.specification(), campaign.description(), campaign.model(), campaign.planned("demo.i01")]
        placements = [archive.commit("demo", step_of(number, message)) for number, message in enumerate(messages)]
        # Those that were there first, then those that were not.
        assert placements == sorted(placements, key=lambda placement: placement is Placement.NEW)
        for item in blocks_of(campaign):
            archive.take_block(item)
        archive.commit("demo", step_of(4, campaign.played("demo.i01", epoch=EPOCH)))
        archive.commit("demo", step_of(5, recorder_pb2.RecordingClosed(reason="done")))
        result = verify(folder, "demo")
        assert result.whole, (place, result.findings)


def test_a_recorder_that_is_killed_while_it_finishes_leaves_nothing_that_cannot_be_finished(
    begin, tmp_path, campaign, step_of
):
    archive = begin(tmp_path)
    before = (tmp_path / "demo.mcap").stat().st_size
    archive.close()
    content = (tmp_path / "demo.mcap").read_bytes()
    for place in range(before, len(content), (len(content) - before) // 6):
        folder = tmp_path / f"cut{place}"
        folder.mkdir()
        (folder / "demo.mcap").write_bytes(content[:place])
        go_on(folder, campaign, step_of)
        assert verify(folder, "demo").whole, place


def test_a_recorder_that_was_stopped_goes_on_in_the_next_file(begin, tmp_path, campaign, step_of):
    begin(tmp_path).close()
    first = (tmp_path / "demo.mcap").read_bytes()
    go_on(tmp_path, campaign, step_of)
    assert verify(tmp_path, "demo").whole
    assert (tmp_path / "demo.mcap").read_bytes() == first
    assert not (tmp_path / DAMAGED_FOLDER).exists()


def test_an_ended_recording_is_left_as_it_is_and_its_last_step_acknowledged(begin, tmp_path, campaign, step_of):
    archive = begin(tmp_path)
    archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))
    content = (tmp_path / "demo.mcap").read_bytes()
    archive = Archive(tmp_path)
    archive.recover()
    assert archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done"))) is Placement.STORED
    with pytest.raises(RefusedError, match="is closed with 5 steps"):
        archive.commit("demo", step_of(5, campaign.planned("demo.i02")))
    assert (tmp_path / "demo.mcap").read_bytes() == content


def test_what_is_damaged_in_its_middle_is_not_repaired(begin, tmp_path, campaign, step_of):
    begin(tmp_path)
    path = killed(tmp_path, tmp_path / "after") / "demo.mcap"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    archive = Archive(path.parent, least_free_bytes=0)
    archive.recover()
    with pytest.raises(RefusedError, match="cannot be gone on with"):
        archive.commit("demo", step_of(4, campaign.played("demo.i01", epoch=EPOCH)))
    assert path.read_bytes() == content


def test_a_file_that_was_swapped_breaks_the_chain(begin, tmp_path, campaign, step_of):
    begin(tmp_path).close()
    go_on(tmp_path, campaign, step_of)
    other = tmp_path / "other"
    other.mkdir()
    begin(other).close()
    shutil.copy(other / "demo.mcap", tmp_path / "demo.mcap")
    assert any("its hash differs" in finding for finding in verify(tmp_path, "demo").findings)


def test_a_repaired_file_says_why_it_ends(begin, tmp_path, campaign, step_of):
    begin(tmp_path)
    folder = killed(tmp_path, tmp_path / "after")
    Archive(folder).recover()
    assert is_finished(folder / "demo.mcap")
    summary = read_summary(folder / "demo.mcap")
    assert summary is not None
    assert (summary.reason, summary.steps, summary.signal_blocks) == ("Its recorder was killed.", 4, 3)
    # Nothing new is written before there is something to write.
    assert [path.name for path in files_of(folder, "demo")] == ["demo.mcap"]


def test_an_acknowledged_step_survives_a_kill_right_after(tmp_path):
    """A process that commits steps and says each acknowledged number is killed at random moments."""
    program = Path(__file__).with_name("committing_process.py")
    chosen = random.Random(6)
    for round_ in range(2):
        folder = tmp_path / str(round_)
        folder.mkdir()
        with subprocess.Popen(
            [sys.executable, str(program), str(folder)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": ""},
        ) as running:
            assert running.stderr is not None
            acknowledged = [int(running.stderr.readline()) for _ in range(chosen.randrange(1, 60))][-1]
            running.send_signal(signal.SIGKILL)
            # What it still said before it died counts as well.
            acknowledged = max([acknowledged, *map(int, running.stderr.read().split(b"\n")[:-1])])
        archive = Archive(folder, least_free_bytes=0)
        archive.recover()
        found = read_summary(folder / "demo.mcap")
        assert found is not None
        assert found.steps > acknowledged
        assert len(found.step_hashes) == found.steps


def test_a_rigs_state_wakes_no_recording_that_was_broken_off(begin, tmp_path, campaign):
    begin(tmp_path)
    folder = killed(tmp_path, tmp_path / "after")
    archive = Archive(folder, least_free_bytes=0)
    archive.recover()
    item = StreamItem(Keys().rig_state(campaign.rig), 1, 0, rig_pb2.RigState(rig=campaign.rig))
    assert archive.take_state(item) == set()
    assert [path.name for path in files_of(folder, "demo")] == ["demo.mcap"]
    assert archive.take_settled() == [item]


def test_a_repaired_file_passes_the_check_of_another_code_base(begin, tmp_path, rerun_program, viewer_environment):
    begin(tmp_path)
    folder = killed(tmp_path, tmp_path / "after")
    with (folder / "demo.mcap").open("ab") as stream:
        # Half a record, as it is being written.
        stream.write(b"\x06\x00\x10")
    Archive(folder).recover()
    done = subprocess.run(
        [rerun_program, "mcap", "check", str(folder / "demo.mcap")],
        env=viewer_environment,
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_links_and_folders_that_are_named_like_recordings_are_passed_over(begin, tmp_path):
    begin(tmp_path)
    (tmp_path / "link.mcap").symlink_to(tmp_path / "demo.mcap")
    (tmp_path / "nowhere.mcap").symlink_to("/there/is/nothing.mcap")
    (tmp_path / "folder.mcap").mkdir()
    assert recordings_in(tmp_path) == ["demo"]
    again = Archive(tmp_path, least_free_bytes=0)
    again.recover()
    assert again.counts() == (1, 0)


@pytest.mark.parametrize("size", [0, 5, 8, 20, 36])
def test_a_file_that_was_only_begun_is_put_aside_and_its_name_is_free(tmp_path, campaign, step_of, size):
    (tmp_path / "demo.mcap").write_bytes((MAGIC + bytes(100))[:size])
    again = Archive(tmp_path, least_free_bytes=0)
    again.recover()
    assert again.counts() == (0, 0)
    assert (tmp_path / "damaged" / "demo.mcap").stat().st_size == size
    again.commit("demo", step_of(0, campaign.specification()))
    again.close()


def test_a_file_is_begun_where_a_repair_finds_a_step(tmp_path, campaign, step_of):
    archive = Archive(tmp_path, least_free_bytes=0)
    archive.commit("demo", step_of(0, campaign.specification()))
    content = (tmp_path / "demo.mcap").read_bytes()
    archive.close()
    found = set()
    for size in {*range(0, len(content), 61), *range(len(content) - 45, len(content) + 1)}:
        folder = tmp_path / str(size)
        folder.mkdir()
        path = folder / "demo.mcap"
        path.write_bytes(content[:size])
        begun = is_begun(path)
        Archive(folder, least_free_bytes=0).recover()
        assert path.is_file() == begun, size
        found.add(begun)
    assert found == {False, True}


def test_what_is_damaged_or_cannot_be_read_is_left_to_its_reader(tmp_path):
    path = tmp_path / "demo.mcap"
    assert is_begun(path)
    path.write_bytes(b"not an MCAP file")
    assert is_begun(path)
    os.mkfifo(tmp_path / "pipe.mcap")
    assert is_begun(tmp_path / "pipe.mcap")
    assert is_begun(tmp_path)


@pytest.mark.parametrize("ending", ["killed", "killed twice", "closed", "split"])
def test_states_and_events_that_come_again_after_a_kill_are_stored_once(begin, tmp_path, campaign, step_of, ending):
    state = campaign.state(rig_pb2.RIG_MODE_PLAYING, run="demo.i01")
    event = iterator_pb2.CampaignEvent(status=iterator_pb2.CampaignStatus(id="demo"))
    # The recorder was started after the streams; the one on a key of another epoch is another message.
    states = [StreamItem(Keys().rig_state(campaign.rig), epoch, seq, state) for epoch in (1, 2) for seq in range(5, 9)]
    events = [StreamItem(Keys().campaign_event("demo"), 3, seq, event) for seq in range(4)]

    def give(archive, most):
        for item in states[:most]:
            archive.take_state(item)
        for item in events[:most]:
            archive.take_event(item)
        archive.sync()

    archive = begin(tmp_path)
    give(archive, 3)
    if ending == "closed":
        archive.close()
    elif ending == "split":
        archive._split_bytes = 1
        archive.sync()
    folder = killed(tmp_path, tmp_path / "after")
    again = Archive(folder, least_free_bytes=0)
    again.recover()
    if ending == "killed twice":
        folder = killed(folder, tmp_path / "once more")
        again = Archive(folder, least_free_bytes=0)
        again.recover()
    again.commit("demo", step_of(4, campaign.planned("demo.i02")))
    give(again, len(states))
    # What is passed over is settled as well, or its publisher would keep it.
    assert len(again.take_settled()) == len(states) + len(events)
    again.commit("demo", step_of(5, recorder_pb2.RecordingClosed(reason="done")))
    stored = []
    for path in files_of(folder, "demo"):
        with path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                if not channel.topic.startswith("step/") and "/signal/" not in channel.topic:
                    stored.append((channel.topic, int(channel.metadata["epoch"]), message.sequence))
    assert sorted(stored) == sorted(item.position for item in [*states, *events])


def test_a_summary_tells_which_states_and_events_are_stored():
    streams = {("duralab/v1/local/rig/r/state", 2**63): Continuity()}
    # The last is a stranger's: it must not make the whole unreadable.
    for seq in (3, 4, 8, 2**64 - 1):
        streams["duralab/v1/local/rig/r/state", 2**63].accept(seq)
    found = Summary.from_metadata(Summary("demo", "done", streams=streams).to_metadata())
    ((place, stored),) = found.streams.items()
    assert place == ("duralab/v1/local/rig/r/state", 2**63)
    assert (stored.missing(9), stored.received) == ([range(3), range(5, 8)], 4)
    older = {name: text for name, text in Summary("demo", "done").to_metadata().items() if name != "streams"}
    assert Summary.from_metadata(older).streams == {}
