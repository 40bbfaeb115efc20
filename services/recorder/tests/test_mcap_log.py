from __future__ import annotations

import os
import subprocess

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from duralab_proto.v1 import iterator_pb2, recorder_pb2
from recorder.mcap_log import McapLog


@pytest.fixture
def log_file(tmp_path, campaign):
    log = McapLog(tmp_path / "demo.mcap")
    log.add_metadata("scenario", {"yaml": "a: 1"})
    specification = campaign.specification()
    log.add_message("step/CampaignSpec", specification.SerializeToString(), kind=type(specification), sequence=0)
    for number, block in enumerate(campaign.blocks("demo.i01")):
        log.add_message("signal", block.SerializeToString(), kind=type(block), sequence=number, metadata={"epoch": "7"})
    log.close()
    return log.path


def test_standard_tools_decode_every_message(log_file, campaign):
    with log_file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    assert decoded[0][1].SerializeToString() == campaign.specification().SerializeToString()
    blocks = [message for topic, message in decoded if topic == "signal"]
    assert [block.first_sample for block in blocks] == [0, 50, 100, 150]


def test_rerun_finds_the_file_sound(log_file, rerun_program, viewer_environment):
    done = subprocess.run(
        [rerun_program, "mcap", "check", str(log_file)],
        env=viewer_environment,
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_two_epochs_of_a_topic_are_two_channels(tmp_path):
    log = McapLog(tmp_path / "demo.mcap")
    for epoch in ("1", "2"):
        log.add_message("t", b"", kind=recorder_pb2.RecordingClosed, sequence=0, metadata={"epoch": epoch})
    log.close()
    with log.path.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    assert sorted(channel.metadata["epoch"] for channel in channels) == ["1", "2"]


def test_what_is_there_already_is_not_touched(tmp_path):
    path = tmp_path / "demo.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        McapLog(path)
    assert path.read_bytes() == b"precious"


def test_a_failed_creation_leaves_no_file(tmp_path, monkeypatch):
    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        McapLog(tmp_path / "demo.mcap")
    assert list(tmp_path.iterdir()) == []


def test_synced_messages_survive_without_a_footer(tmp_path, campaign):
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    log = McapLog(tmp_path / "demo.mcap")
    status = campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING)
    log.add_message("step/CampaignStatus", status.SerializeToString(), kind=type(status), sequence=0)
    log.sync()
    copy = (tmp_path / "killed.mcap").absolute()
    copy.write_bytes(log.path.read_bytes())
    log.close()
    with copy.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        first = next(record for record in records if isinstance(record, Message))
    assert first.data == status.SerializeToString()
