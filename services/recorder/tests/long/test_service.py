"""The recorder as a process on a real bus."""

from __future__ import annotations

import contextlib
import hashlib
import json
import signal
import subprocess
import sys
import threading
import time
from unittest import mock

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from duralab_bus import BusConfig, Call, FaultError, StreamItem, open_bus
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2
from recorder import service
from recorder.config import RecorderConfig
from recorder.service import RecorderService

END_SECONDS = 60.0


class Lab:
    """A bus and a recorder process on it."""

    def __init__(self, bus, folder, config):
        self.bus = bus
        self.folder = folder
        self.steps: dict[str, int] = {}
        self._config = config
        self.process = self._started()

    def _started(self):
        process = subprocess.Popen(
            [sys.executable, "-m", "recorder", "--config", str(self._config)],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.bus.wait_for_live({("recorder", "main")}, 120.0)
        return process

    def kill_and_start_again(self, *, meanwhile):
        self.end(signal.SIGKILL)
        for pipe in (self.process.stdin, self.process.stderr):
            pipe.close()
        until = time.monotonic() + END_SECONDS
        while self.bus.live("recorder") and time.monotonic() < until:
            time.sleep(0.02)
        meanwhile()
        self.process = self._started()

    def commit(self, message, recording="demo", step=None, longest_seconds=None):
        number = self.steps.get(recording, 0) if step is None else step
        request = recorder_pb2.CommitRequest(
            recording=recording,
            step=number,
            message_type=message.DESCRIPTOR.full_name,
            payload=message.SerializeToString(),
        )
        answer = self.bus.query(
            self.bus.keys.commit(), request, recorder_pb2.CommitAck, longest_seconds=longest_seconds
        )
        self.steps[recording] = max(self.steps.get(recording, 0), number + 1)
        assert answer.payload_hash == hashlib.sha256(request.payload).hexdigest()
        return answer

    def play(self, campaign, run, *, blocks=None, lose=lambda _publisher: None):
        publisher = self.bus.publisher(self.bus.keys.rig_signal(campaign.rig, run))
        lose(publisher)
        for block in campaign.blocks(run) if blocks is None else blocks:
            publisher.put(block)
        publisher.close()
        return publisher.epoch

    def information(self, recording="demo"):
        key = self.bus.keys.recording(recording)
        return self.bus.query(key, recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo)

    def end(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        _, errors = self.process.communicate(timeout=END_SECONDS)
        return errors.decode()


@pytest.fixture
def lab(tmp_path):
    with open_bus(BusConfig(lab="test"), service="duralab") as bus:
        folder = tmp_path / "recordings"
        config = tmp_path / "recorder.yaml"
        # JSON is YAML.
        config.write_text(
            json.dumps(
                {"bus": {"lab": "test", "connect": [bus.listening[0]]}, "folder": str(folder), "exit_with_parent": True}
            )
        )
        lab = Lab(bus, folder, config)
        try:
            yield lab
        finally:
            if lab.process.poll() is None:
                lab.process.kill()
                lab.process.communicate()
            for pipe in (lab.process.stdin, lab.process.stderr):
                pipe.close()


def record_campaign(lab, campaign):
    for message in (campaign.specification(), campaign.description(), campaign.target_in_band()):
        lab.commit(message)
    events = lab.bus.publisher(lab.bus.keys.campaign_event("demo"))
    for iteration, error in ((1, 0.5), (2, 0.2)):
        run = f"demo.i{iteration:02d}"
        lab.commit(campaign.planned(run))
        events.put(iterator_pb2.CampaignEvent(status=campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING)))
        lab.commit(campaign.played(run, epoch=lab.play(campaign, run)))
        lab.commit(campaign.iteration(iteration, error))
    events.close()


def test_a_campaign_is_recorded_read_back_and_verified(lab, campaign):
    record_campaign(lab, campaign)
    open_information = lab.information()
    assert (open_information.closed, open_information.signal_blocks, open_information.missing_blocks) == (False, 8, 0)
    lab.commit(recorder_pb2.RecordingClosed(reason="done"))
    information = lab.information()
    assert (information.closed, information.steps, information.signal_blocks) == (True, 10, 8)

    keys = lab.bus.keys
    listed = lab.bus.query(keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList)
    unhashed = recorder_pb2.RecordingInfo.FromString(information.SerializeToString())
    unhashed.file_hash = unhashed.files[0].file_hash = ""
    assert list(listed.recordings) == [unhashed]
    request = recorder_pb2.ReadRecordingRequest(offset=0, length=8 * 2**20, part="recording")
    part = lab.bus.query(keys.recording_read("demo"), request, recorder_pb2.RecordingPart)
    assert hashlib.sha256(part.data).hexdigest() == information.file_hash
    request.part = "live"
    live = lab.bus.query(keys.recording_read("demo"), request, recorder_pb2.RecordingPart)
    assert live.data == (lab.folder / "demo.rrd").read_bytes()
    verdict = lab.bus.query(
        keys.recording_verify("demo"), recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult
    )
    assert verdict.whole, verdict.findings

    with (lab.folder / "demo.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    kept = [message for topic, message in decoded if topic == keys.rig_signal(campaign.rig, "demo.i02")]
    assert [block.SerializeToString() for block in kept] == [
        block.SerializeToString() for block in campaign.blocks("demo.i02")
    ]
    assert sum(topic == keys.campaign_event("demo") for topic, _ in decoded) == 2
    assert metadata["scenario"]["yaml"] == "road: belgian block\n"
    assert "mcap" in metadata["software"]

    lab.end()
    assert lab.process.returncode == 0


def test_refusals_come_as_faults(lab, campaign):
    lab.commit(campaign.specification())
    with pytest.raises(FaultError, match="leaves a gap") as caught:
        lab.commit(campaign.description(), step=5)
    assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
    for name in ("../demo", "", "Demo"):
        with pytest.raises(FaultError) as caught:
            lab.commit(campaign.specification(), recording=name)
        assert (caught.value.code, caught.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, "recording")
    with pytest.raises(FaultError) as caught:
        lab.information("nobody")
    assert caught.value.code == query_pb2.FAULT_CODE_NOT_FOUND
    request = recorder_pb2.ReadRecordingRequest(length=1, part="recording")
    with pytest.raises(FaultError, match="still written"):
        lab.bus.query(lab.bus.keys.recording_read("demo"), request, recorder_pb2.RecordingPart)
    # The same step again, as after a lost answer.
    lab.commit(campaign.specification(), step=0)


@pytest.mark.parametrize("lost", [{1}, {0, 2}, {2, 3}, {0, 1, 2, 3}])
def test_blocks_lost_on_the_way_are_replayed_into_their_place(lab, campaign, lose, lost):
    lab.commit(campaign.specification())
    lab.commit(campaign.planned("demo.i01"))
    epoch = lab.play(campaign, "demo.i01", lose=lambda publisher: lose(publisher, lost))
    lab.commit(campaign.played("demo.i01", epoch=epoch))
    information = lab.information()
    assert (information.signal_blocks, information.missing_blocks) == (4, 0)
    lab.commit(recorder_pb2.RecordingClosed(reason="done"))
    topic = lab.bus.keys.rig_signal(campaign.rig, "demo.i01")
    with (lab.folder / "demo.mcap").open("rb") as stream:
        messages = make_reader(stream).iter_messages(topics=[topic], log_time_order=False)
        assert [message.sequence for _, _, message in messages] == [0, 1, 2, 3]


def test_missing_blocks_delay_the_answer_for_a_bounded_time_and_are_told(lab, campaign):
    lab.commit(campaign.specification())
    lab.commit(campaign.planned("demo.i01"))
    epoch = lab.play(campaign, "demo.i01", blocks=campaign.blocks("demo.i01")[:3])
    start = time.monotonic()
    lab.commit(campaign.played("demo.i01", epoch=epoch, blocks=4))
    assert 4.5 < time.monotonic() - start < 8
    assert lab.information().missing_blocks == 1
    log = [json.loads(line) for line in lab.end().splitlines() if line.startswith("{")]
    assert any(entry["event"] == "signal blocks are missing" and entry["missing"] == 1 for entry in log)


def test_a_step_whose_client_gave_up_waits_for_its_blocks_again_when_it_is_sent_again(lab, campaign):
    lab.commit(campaign.specification())
    lab.commit(campaign.planned("demo.i01"))
    publisher = lab.bus.publisher(lab.bus.keys.rig_signal(campaign.rig, "demo.i01"))
    *first, last = campaign.blocks("demo.i01")
    for block in first:
        publisher.put(block)
    played = campaign.played("demo.i01", epoch=publisher.epoch, blocks=4)
    with pytest.raises(FaultError, match=r"has not answered .* within 0.5 s"):
        lab.commit(played, longest_seconds=0.5)
    # Well after the recorder knows, 0.3 s later, that nobody waits for the first one.
    late = threading.Timer(2.0, lambda: publisher.put(last))
    late.start()
    lab.commit(played)
    late.join()
    publisher.close()
    assert (lab.information().steps, lab.information().missing_blocks) == (3, 0)
    log = [json.loads(line) for line in lab.end().splitlines() if line.startswith("{")]
    assert not any(entry["event"] == "signal blocks are missing" for entry in log)


def test_acknowledged_steps_survive_a_kill(lab, campaign):
    record_campaign(lab, campaign)
    lab.end(signal.SIGKILL)
    found = []
    channels = {}
    # A killed file ends somewhere: that is the end of what is read, and no step may be lost before it.
    with (lab.folder / "demo.mcap").open("rb") as stream, contextlib.suppress(EndOfFile):
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            if isinstance(record, Message) and channels[record.channel_id].startswith("step/"):
                found.append(record.sequence)
    assert found == list(range(9))


def test_a_killed_recorder_goes_on_and_gets_what_was_played_meanwhile(lab, campaign):
    for message in (campaign.specification(), campaign.description(), campaign.planned("demo.i01")):
        lab.commit(message)
    publisher = lab.bus.publisher(lab.bus.keys.rig_signal(campaign.rig, "demo.i01"))
    blocks = campaign.blocks("demo.i01")
    for block in blocks[:2]:
        publisher.put(block)

    def play_on():
        for block in blocks[2:]:
            publisher.put(block)

    lab.kill_and_start_again(meanwhile=play_on)
    # The last step again, as a campaign asks that is resumed.
    lab.commit(campaign.planned("demo.i01"), step=2)
    lab.commit(campaign.played("demo.i01", epoch=publisher.epoch))
    lab.commit(campaign.iteration(1, 0.5))
    lab.commit(recorder_pb2.RecordingClosed(reason="done"))
    publisher.close()
    information = lab.information()
    assert (information.steps, information.signal_blocks, information.missing_blocks) == (6, 4, 0)
    assert [file.file for file in information.files] == ["demo.mcap", "demo.part02.mcap"]
    assert (lab.folder / "damaged" / "demo.mcap").is_file()
    verdict = lab.bus.query(
        lab.bus.keys.recording_verify("demo"), recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult
    )
    assert verdict.whole, verdict.findings
    request = recorder_pb2.SignalWindowRequest(run="demo.i01", seconds=2.0)
    window = lab.bus.query(lab.bus.keys.recording_signals("demo"), request, recorder_pb2.SignalWindow)
    assert list(window.response.samples.shape) == [2, 200]


def test_recordings_are_found_by_what_they_were_about(lab, campaign):
    record_campaign(lab, campaign)
    lab.commit(campaign.status(iterator_pb2.CAMPAIGN_PHASE_FINISHED))
    lab.commit(recorder_pb2.RecordingClosed(reason="done"))

    def found(**wanted):
        request = recorder_pb2.ListRecordingsRequest(**wanted)
        answer = lab.bus.query(lab.bus.keys.recordings(), request, recorder_pb2.RecordingList)
        return [information.recording for information in answer.recordings]

    def found_in(project):
        key = lab.bus.keys.project_recordings(project)
        answer = lab.bus.query(key, recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList)
        return [information.recording for information in answer.recordings]

    assert (found_in("demo"), found_in("dem")) == (["demo"], [])
    begun = lab.information().begun
    assert begun > 0
    for wanted in (
        {},
        {"rig": "front_axle"},
        {"begun_from": begun, "begun_before": begun + 1},
        {"phase": iterator_pb2.CAMPAIGN_PHASE_FINISHED},
    ):
        assert found(**wanted) == ["demo"], wanted
    for wanted in (
        {"rig": "predecessor"},
        {"target": "belgian"},
        {"begun_from": begun + 1},
        {"begun_before": begun},
        {"outcome": iterator_pb2.OUTCOME_REACHED},
    ):
        assert found(**wanted) == [], wanted


def test_a_recorder_that_cannot_write_says_so_in_a_sentence(tmp_path):
    (tmp_path / "file").touch()
    config = tmp_path / "recorder.yaml"
    config.write_text(json.dumps({"folder": str(tmp_path / "file" / "recordings")}))
    done = subprocess.run(
        [sys.executable, "-m", "recorder", "--config", str(config)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 2
    assert "correct `folder`" in done.stderr.splitlines()[-1]


def test_what_nobody_should_publish_is_let_go_and_told_to_its_publisher(tmp_path, campaign):
    service = RecorderService(RecorderConfig(folder=tmp_path, live_file=False))
    event = iterator_pb2.CampaignEvent(status=campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING))
    item = StreamItem(Keys().campaign_event("demo").replace("/demo", "/start"), 1, 0, event)
    try:
        service._taking(service._archive.take_event)(item)
        service._on_writer(service._mark)
        assert service._intake._bytes == 0
    finally:
        service.close()


def test_a_recording_that_is_deleted_while_it_is_listed_is_left_out(lab, campaign, monkeypatch):
    lab.commit(campaign.specification())
    lab.end(signal.SIGTERM)
    gone = lab.folder / "gone.mcap"
    gone.write_bytes((lab.folder / "demo.mcap").read_bytes())
    recorder = service.RecorderService(RecorderConfig(folder=lab.folder, live_file=False))
    named = service.recordings_in

    def delete_after_naming(folder):
        names = named(folder)
        gone.unlink()
        return names

    monkeypatch.setattr(service, "recordings_in", delete_after_naming)
    try:
        found = recorder.list_recordings(recorder_pb2.ListRecordingsRequest(), mock.create_autospec(Call))
    finally:
        recorder.close()
    assert [information.recording for information in found.recordings] == ["demo"]
