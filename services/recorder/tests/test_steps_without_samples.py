"""A step may leave its samples to the signal blocks of its run: stored only when these are on disk and are those."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from mcap.reader import make_reader

from duralab_bus import StreamItem
from duralab_proto.arrays import from_array, samples_hash
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_recordings import hash_of_blocks
from recorder.format import files_of
from recorder.log import Archive
from recorder.reading import audit, read_steps
from recorder.refused import RefusedError

RUN, EPOCH = "demo.i01", 1_700_000_000_000_000_000
ORDERS = {"in order": [0, 1, 2, 3], "one late": [0, 2, 3, 1], "the first last": [1, 2, 3, 0]}


def topic(campaign):
    return Keys().rig_signal(campaign.rig, RUN)


def step_of_run(campaign, *, samples=None, **others):
    """The playback of the run, without its samples."""
    drive, response = samples or (campaign.target * 1e-6, campaign.target * 0.9)
    step = campaign.iteration(1, 0.1)
    step.ClearField("drive")
    step.ClearField("response")
    step.samples_hash, step.signal_epoch, step.signal_blocks = samples_hash(drive, response), EPOCH, 4
    for name, value in others.items():
        setattr(step, name, value)
    return step


@pytest.fixture
def played(tmp_path, campaign, step_of):
    """Return a function that makes an archive whose run is played: the blocks of these numbers, in this order."""

    def make(numbers=(0, 1, 2, 3), *, folder=tmp_path, **options):
        archive = Archive(folder, least_free_bytes=0, **options)
        for number, message in enumerate([campaign.specification(), campaign.description(), campaign.planned(RUN)]):
            archive.commit("demo", step_of(number, message))
        blocks = campaign.blocks(RUN)
        for seq in numbers:
            archive.take_block(StreamItem(topic(campaign), EPOCH, seq, blocks[seq]))
        return archive

    return make


def found_hash(archive, campaign):
    return hash_of_blocks(archive.places("demo", topic(campaign), epoch=EPOCH))


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("split_bytes", [2**30, 1])
def test_the_hash_of_a_run_is_that_of_its_samples_on_disk(played, campaign, order, split_bytes):
    archive = played((), split_bytes=split_bytes)
    blocks = campaign.blocks(RUN)
    for seq in order:
        archive.take_block(StreamItem(topic(campaign), EPOCH, seq, blocks[seq]))
        # Each in a chunk of its own, or in a file of its own.
        archive.sync()
    assert found_hash(archive, campaign) == samples_hash(campaign.target * 1e-6, campaign.target * 0.9)
    archive.close()


@pytest.mark.parametrize("numbers", [(), (0, 1, 2), (0, 1, 3), (1, 2, 3)])
def test_a_run_that_is_not_whole_has_no_hash(played, campaign, numbers):
    archive = played(numbers)
    assert found_hash(archive, campaign) == ""
    archive.close()


def test_a_step_is_stored_when_the_samples_are_those_of_its_hash(played, campaign, step_of, tmp_path):
    archive = played()
    archive.commit("demo", step_of(3, step_of_run(campaign)), samples_hash=found_hash(archive, campaign))
    archive.commit("demo", step_of(4, campaign.played(RUN, epoch=EPOCH)))
    archive.commit("demo", step_of(5, recorder_pb2.RecordingClosed(reason="done")))
    assert audit(files_of(tmp_path, "demo")).findings == []
    answer = read_steps(
        files_of(tmp_path, "demo"), recorder_pb2.ReadStepsRequest(first=3, with_samples=True), written=None
    )
    np.testing.assert_array_equal(from_array(answer.steps[0].drive), campaign.target * 1e-6)
    np.testing.assert_array_equal(from_array(answer.steps[0].response), campaign.target * 0.9)
    assert answer.steps[0].payload == step_of_run(campaign).SerializeToString()
    assert not answer.steps[1].HasField("response")
    plain = read_steps(files_of(tmp_path, "demo"), recorder_pb2.ReadStepsRequest(first=3), written=None)
    assert not plain.steps[0].HasField("response")


def test_steps_of_an_open_recording_are_read_with_their_samples(played, campaign, step_of, tmp_path):
    """As a resumed campaign reads them after its iterator was killed."""
    archive = played()
    archive.commit("demo", step_of(3, step_of_run(campaign)), samples_hash=found_hash(archive, campaign))
    request = recorder_pb2.ReadStepsRequest(first=3, with_samples=True)
    answer = read_steps(files_of(tmp_path, "demo"), request, written=4)
    np.testing.assert_array_equal(from_array(answer.steps[0].response), campaign.target * 0.9)
    archive.close()


@pytest.mark.parametrize("other", ["missing", "another"])
def test_a_step_whose_samples_are_not_here_is_refused_and_taken_with_them(played, campaign, step_of, tmp_path, other):
    archive = played((0, 1, 2) if other == "missing" else (0, 1, 2, 3))
    samples = (campaign.target * 1e-6, campaign.target * 0.8)
    lacking = step_of_run(campaign, samples=samples)
    said = "not here, or not whole" if other == "missing" else "others than those of its hash"
    with pytest.raises(RefusedError, match=rf"run 'demo.i01' are {said}; send the step with its samples") as caught:
        archive.commit("demo", step_of(3, lacking), samples_hash=found_hash(archive, campaign))
    assert (caught.value.code, caught.value.field) == (
        query_pb2.FAULT_CODE_FAILED_PRECONDITION,
        "payload.samples_hash",
    )
    whole = campaign.iteration(1, 0.2)
    archive.commit("demo", step_of(3, whole))
    archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))
    steps = read_steps(files_of(tmp_path, "demo"), recorder_pb2.ReadStepsRequest(with_samples=True), written=None).steps
    assert steps[3].payload == whole.SerializeToString()


def test_what_was_acknowledged_is_there_after_a_kill(played, campaign, step_of, tmp_path):
    archive = played()
    archive.commit("demo", step_of(3, step_of_run(campaign)), samples_hash=found_hash(archive, campaign))
    left = tmp_path / "left"
    left.mkdir()
    # The bytes on the disk when the acknowledgement is sent: nothing more was written.
    shutil.copy(tmp_path / "demo.mcap", left / "demo.mcap")
    archive.close()
    again = Archive(left, least_free_bytes=0)
    again.recover()
    assert hash_of_blocks(again.places("demo", topic(campaign), epoch=EPOCH)) == step_of_run(campaign).samples_hash
    # The same step again is acknowledged, whatever is known of its run.
    again.commit("demo", step_of(3, step_of_run(campaign)))
    again.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))
    assert audit(files_of(left, "demo")).findings == []


def test_verify_names_a_run_whose_samples_are_others(played, campaign, step_of, tmp_path):
    archive = played()
    wrong = step_of_run(campaign, samples_hash="0" * 64)
    archive.commit("demo", step_of(3, wrong), samples_hash="0" * 64)
    archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))
    assert audit(files_of(tmp_path, "demo")).findings == [
        "The samples of run 'demo.i01' are not those of the hash that its step names."
    ]
    with pytest.raises(RefusedError, match="are not the samples that its step was made of"):
        read_steps(files_of(tmp_path, "demo"), recorder_pb2.ReadStepsRequest(with_samples=True), written=None)


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"samples_hash": ""}, "samples_hash"),
        ({"samples_hash": "g" * 64}, "samples_hash"),
        ({"signal_blocks": 0}, "signal_blocks"),
        ({"signal_blocks": 2**33}, "signal_blocks"),
        ({"run": "no/run"}, "run"),
    ],
)
def test_a_step_without_samples_has_to_name_them(campaign, step_of, wrong, field):
    with pytest.raises(RefusedError) as caught:
        step_of(3, step_of_run(campaign, **wrong))
    assert caught.value.field == f"payload.{field}"
    step = iterator_pb2.IterationStep()
    step.CopyFrom(campaign.iteration(1, 0.1))
    step.ClearField("drive")
    with pytest.raises(RefusedError, match="drive and response are not both given"):
        step_of(3, step)


@pytest.mark.parametrize(("epoch", "begins"), [(EPOCH, EPOCH), (7, None)])
def test_blocks_and_poses_are_published_at_the_time_of_their_samples(tmp_path, campaign, step_of, epoch, begins):
    """So that a tool for MCAP files draws a run over its own time; an epoch that is no time begins as it is stored."""
    archive = Archive(tmp_path, least_free_bytes=0)
    for number, message in enumerate([campaign.specification(), campaign.description(), campaign.planned(RUN)]):
        archive.commit("demo", step_of(number, message))
    for seq, block in enumerate(campaign.blocks(RUN)):
        archive.take_block(StreamItem(topic(campaign), epoch, seq, block))
    archive.take_pose(StreamItem(Keys().rig_pose(campaign.rig), 3, 0, campaign.poses(RUN)))
    archive.close()
    with (tmp_path / "demo.mcap").open("rb") as stream:
        records = list(make_reader(stream).iter_messages(log_time_order=False))
    blocks = [record for schema, _, record in records if schema.name == rig_pb2.SignalBlock.DESCRIPTOR.full_name]
    poses = [record for schema, _, record in records if schema.name == rig_pb2.PoseBlock.DESCRIPTOR.full_name]
    begin = blocks[0].publish_time
    assert [block.publish_time - begin for block in blocks] == [0, 500_000_000, 1_000_000_000, 1_500_000_000]
    assert poses[0].publish_time == begin
    assert begin == begins if begins is not None else abs(begin - blocks[0].log_time) < 10**10
    assert blocks[0].log_time >= 1_700_000_000_000_000_000
