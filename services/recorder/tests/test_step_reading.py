"""What was committed comes back byte for byte, whoever was killed."""

import shutil

import pytest

from duralab_proto.v1 import recorder_pb2
from duralab_recordings import index, unfinished
from recorder.log import Archive
from recorder.reading import read_steps
from recorder.refused import RefusedError


@pytest.fixture
def archive(tmp_path):
    archive = Archive(tmp_path)
    yield archive
    archive.close()


def commit(archive, step_of, messages):
    for number, message in enumerate(messages):
        archive.commit("demo", step_of(number, message))


def read(path, first=0, *, written=None):
    return read_steps([path], recorder_pb2.ReadStepsRequest(first=first), written=written)


def test_steps_come_back_in_order_while_the_recording_is_written(archive, campaign, step_of, tmp_path):
    messages = [campaign.specification(), campaign.description(), campaign.iteration(1, 0.5)]
    commit(archive, step_of, messages)
    answer = read(tmp_path / "demo.mcap", written=3)
    assert answer.total == 3
    assert [step.payload for step in answer.steps] == [message.SerializeToString() for message in messages]
    assert [step.message_type for step in answer.steps] == [message.DESCRIPTOR.full_name for message in messages]
    assert [step.step for step in read(tmp_path / "demo.mcap", 2, written=3).steps] == [2]
    assert not read(tmp_path / "demo.mcap", 3, written=3).steps


def test_a_file_that_was_cut_off_gives_all_that_was_acknowledged(archive, campaign, step_of, tmp_path):
    commit(archive, step_of, [campaign.specification(), campaign.description()])
    whole = (tmp_path / "demo.mcap").read_bytes()
    archive.commit("demo", step_of(2, campaign.iteration(1, 0.5)))
    cut = tmp_path / "cut.mcap"
    shutil.copy(tmp_path / "demo.mcap", cut)
    with cut.open("r+b") as stream:
        stream.truncate(len(whole) + 40)
    assert read(cut).total == 2


def test_damage_is_told_and_not_taken_for_the_end(archive, campaign, step_of, tmp_path):
    commit(archive, step_of, [campaign.specification(), campaign.description()])
    content = bytearray((tmp_path / "demo.mcap").read_bytes())
    content[len(content) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(bytes(content))
    with pytest.raises(RefusedError, match="damaged"):
        read(damaged)
    with pytest.raises(RefusedError, match="ends after 2 of 3 steps"):
        read(tmp_path / "demo.mcap", written=3)


def test_a_step_that_is_not_there_is_refused_with_the_number_there_is(archive, campaign, step_of, tmp_path):
    commit(archive, step_of, [campaign.specification()])
    with pytest.raises(RefusedError, match=r"first is 7; recording 'demo' has 1 steps"):
        read(tmp_path / "demo.mcap", 7, written=1)
    archive.close()
    assert read(tmp_path / "demo.mcap").total == 1


def test_a_long_recording_comes_in_parts(archive, campaign, step_of, tmp_path, monkeypatch):
    messages = [
        campaign.specification(),
        campaign.description(),
        campaign.iteration(1, 0.5),
        campaign.iteration(2, 0.3),
    ]
    commit(archive, step_of, messages)
    monkeypatch.setattr(
        "recorder.reading.signal_windows.LARGEST_ANSWER", messages[0].ByteSize() + messages[1].ByteSize()
    )
    assert [step.step for step in read(tmp_path / "demo.mcap").steps] == [0, 1]
    assert [step.step for step in read(tmp_path / "demo.mcap", 2).steps] == [2]
    assert read(tmp_path / "demo.mcap", 2).total == 4


@pytest.mark.parametrize("state", ["open", "killed", "closed"])
def test_each_part_reads_its_own_chunks_and_no_others(archive, campaign, step_of, tmp_path, monkeypatch, state):
    messages = [campaign.specification(), campaign.description(), *(campaign.iteration(n, 0.5) for n in range(1, 7))]
    commit(archive, step_of, messages)
    if state == "closed":
        archive.close()
    read_chunks, scanned = [], []
    monkeypatch.setattr("recorder.reading.signal_windows.LARGEST_ANSWER", 1)
    monkeypatch.setattr(
        "recorder.reading.signal_windows.messages_of",
        lambda *place: read_chunks.append(place) or index.messages_of(*place),
    )
    monkeypatch.setattr(index, "scan", lambda *file: scanned.append(file) or unfinished.scan(*file))
    for number, message in enumerate(messages):
        answer = read(tmp_path / "demo.mcap", number, written=len(messages) if state == "open" else None)
        assert [step.payload for step in answer.steps] == [message.SerializeToString()]
        assert answer.total == len(messages)
    # Its own chunk, and the next one, whose step does not fit any more.
    assert len(read_chunks) == 2 * len(messages) - 1
    assert len(scanned) == (state != "closed")


def test_a_message_index_that_is_none_is_damage(archive, campaign, step_of, tmp_path):
    commit(archive, step_of, [campaign.specification()])
    archive.close()
    path = tmp_path / "demo.mcap"
    (offset,) = index.index_of(path).chunk_indexes[0].message_index_offsets.values()
    content = bytearray(path.read_bytes())
    content[offset] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(RefusedError, match=f"damaged: at byte {offset} is no message index of channel"):
        read(path)
