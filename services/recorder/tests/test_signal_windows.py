"""Parts of a run's signals, by time and channel."""

from __future__ import annotations

import numpy as np
import pytest

from duralab_bus import StreamItem
from duralab_proto.arrays import from_record
from duralab_proto.keys import Keys
from duralab_proto.v1 import query_pb2, recorder_pb2
from duralab_recordings import windows
from recorder.log import Archive
from recorder.reading import read_window, signal_windows
from recorder.refused import RefusedError

RUN = "demo.i01"
ORDER = {"in order": [0, 1, 2, 3], "one late": [0, 2, 3, 1], "the first last": [1, 2, 3, 0]}


def begun(folder, campaign, step_of):
    archive = Archive(folder, least_free_bytes=0)
    for number, message in enumerate([campaign.specification(), campaign.description(), campaign.planned(RUN)]):
        archive.commit("demo", step_of(number, message))
    return archive


@pytest.fixture(params=ORDER)
def folder(request, tmp_path, campaign, step_of):
    archive = begun(tmp_path, campaign, step_of)
    blocks = campaign.blocks(RUN)
    for seq in ORDER[request.param]:
        archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, seq, blocks[seq]))
        # Each in a chunk of its own.
        archive.sync()
    archive.commit("demo", step_of(3, recorder_pb2.RecordingClosed(reason="done")))
    return tmp_path


def window(folder, first, seconds, channels=(), run=RUN):
    request = recorder_pb2.SignalWindowRequest(run=run, first_second=first, seconds=seconds, channels=channels)
    return read_window(folder, "demo", request)


@pytest.mark.parametrize(("first", "seconds"), [(0.0, 2.0), (0.4, 0.3), (0.5, 0.5), (1.99, 0.01), (0.0, 0.01)])
def test_a_window_holds_the_samples_of_its_time(folder, campaign, first, seconds):
    found = window(folder, first, seconds)
    begin, end = round(first * 100), round((first + seconds) * 100)
    _, rate, response = from_record(found.response, field="response")
    _, _, drive = from_record(found.drive, field="drive")
    assert (found.first_sample, rate) == (begin, 100.0)
    np.testing.assert_array_equal(response, campaign.target[:, begin:end] * 0.9)
    np.testing.assert_array_equal(drive, campaign.target[:, begin:end] * 1e-6)


@pytest.mark.parametrize("seconds", [5.0, 1e300, 1e307])
def test_a_window_beyond_the_end_holds_what_there_is(folder, seconds):
    assert from_record(window(folder, 1.9, seconds).response, field="response")[2].shape == (2, 10)


def test_a_window_that_is_too_large_is_refused_with_the_longest_that_is_not(folder, monkeypatch):
    # Of two drives and two responses of eight bytes.
    monkeypatch.setattr(signal_windows, "LARGEST_WINDOW_BYTES", 150 * 32)
    with pytest.raises(RefusedError, match=r"seconds is 1e\+300; at most 1\.5 s of this run are read at once"):
        window(folder, 0.0, 1e300, channels=["right_vertical"])
    assert from_record(window(folder, 0.0, 1.5).response, field="response")[2].shape == (2, 150)
    assert from_record(window(folder, 1.0, 1e300).response, field="response")[2].shape == (2, 100)


def test_only_the_channels_asked_for_come(folder, campaign):
    found = window(folder, 0.0, 1.0, channels=["right_vertical"])
    # A drive and a response have that name.
    assert [channel.name for channel in found.response.channels] == ["right_vertical"]
    np.testing.assert_array_equal(from_record(found.response, field="response")[2], campaign.target[1:, :100] * 0.9)


@pytest.mark.parametrize(
    ("wrong", "field", "code"),
    [
        ({"first": -1.0, "seconds": 1.0}, "first_second", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": float("nan"), "seconds": 1.0}, "first_second", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 0.0, "seconds": 0.0}, "seconds", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 1e307, "seconds": 1.0}, "first_second", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 1e300, "seconds": 1.0}, "first_second", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 2.0, "seconds": 1.0}, "first_second", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 0.0, "seconds": 1.0, "channels": ["x"]}, "channels", query_pb2.FAULT_CODE_INVALID_ARGUMENT),
        ({"first": 0.0, "seconds": 1.0, "run": "demo.i02"}, "run", query_pb2.FAULT_CODE_NOT_FOUND),
    ],
)
def test_what_is_not_there_is_refused_by_name(folder, wrong, field, code):
    with pytest.raises(RefusedError) as caught:
        window(folder, **wrong)
    assert field != "run" or f"it has {RUN!r}." in caught.value.message
    assert (caught.value.field, caught.value.code) == (field, code)


def test_a_time_beyond_the_end_is_told_where_the_run_ends(folder):
    with pytest.raises(RefusedError, match=rf"first_second is 7; run '{RUN}' ends at 2 s\."):
        window(folder, 7.0, 1.0)


def test_a_run_that_was_broken_off_is_told_how_far_it_goes(tmp_path, campaign, step_of):
    archive = begun(tmp_path, campaign, step_of)
    for seq, block in enumerate(campaign.blocks(RUN)[:3]):
        archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, seq, block))
    archive.commit("demo", step_of(3, recorder_pb2.RecordingClosed(reason="stopped")))
    assert from_record(window(tmp_path, 1.0, 0.5).response)[2].shape == (2, 50)
    with pytest.raises(RefusedError, match=r"here up to 1\.5 s, has no whole signals from 1 s on for 1 s"):
        window(tmp_path, 1.0, 1.0)


def test_a_block_that_cannot_be_decoded_is_damage_and_no_wrong_request(tmp_path, campaign, step_of, monkeypatch):
    archive = begun(tmp_path, campaign, step_of)
    blocks = campaign.blocks(RUN)
    # Its checksum is right: it was stored like that.
    blocks[1].response.data = blocks[1].response.data[:-3]
    monkeypatch.setattr("recorder.log.archive._check_block", lambda *_, **__: None)
    for seq, block in enumerate(blocks):
        archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, seq, block))
    archive.commit("demo", step_of(3, recorder_pb2.RecordingClosed(reason="done")))
    with pytest.raises(RefusedError, match="is damaged: response has") as caught:
        window(tmp_path, 0.6, 0.2)
    assert caught.value.code == query_pb2.FAULT_CODE_DATA_LOSS


def test_a_recording_without_an_end_is_said_to_be_not_finished(tmp_path, campaign, step_of):
    archive = begun(tmp_path, campaign, step_of)
    archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, RUN), 7, 0, campaign.blocks(RUN)[0]))
    archive.sync()
    left = tmp_path / "left"
    left.mkdir()
    # As a killed recorder leaves it: after a part with the rig's description, and before it.
    (left / "demo.mcap").write_bytes((tmp_path / "demo.mcap").read_bytes())
    archive.close()
    (left / "split.mcap").write_bytes((tmp_path / "demo.mcap").read_bytes())
    (left / "split.part02.mcap").write_bytes((left / "demo.mcap").read_bytes())
    for name, run in (("demo", RUN), ("split", "demo.i02")):
        with pytest.raises(RefusedError, match=rf"is not finished: .*`duralab resume {name}`") as caught:
            read_window(left, name, recorder_pb2.SignalWindowRequest(run=run, seconds=1.0))
        assert caught.value.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION


def test_the_playback_that_ended_is_read_though_a_clock_was_set_back_before_it(tmp_path, campaign, step_of):
    archive = begun(tmp_path, campaign, step_of)
    key = Keys().rig_signal(campaign.rig, RUN)
    broken_off, played = 2000, 1000
    for seq, block in enumerate(campaign.blocks(RUN, gain=0.1)[:2]):
        archive.take_block(StreamItem(key, broken_off, seq, block))
    for seq, block in enumerate(campaign.blocks(RUN, gain=0.9)):
        archive.take_block(StreamItem(key, played, seq, block))
    # What the first attempt's spool still held comes last.
    archive.sync()
    archive.take_block(StreamItem(key, broken_off, 2, campaign.blocks(RUN, gain=0.1)[2]))
    archive.commit("demo", step_of(3, campaign.played(RUN, epoch=played)))
    archive.commit("demo", step_of(4, recorder_pb2.RecordingClosed(reason="done")))
    for first in (0.0, 1.2):
        _, _, response = from_record(window(tmp_path, first, 0.5).response)
        begin = round(first * 100)
        np.testing.assert_allclose(response, 0.9 * campaign.target[:, begin : begin + 50])


def test_the_places_of_other_runs_are_not_looked_up(tmp_path, campaign, step_of, monkeypatch):
    archive, number = begun(tmp_path, campaign, step_of), 3
    for run in (RUN, "demo.i02", "demo.i03"):
        if run != RUN:
            archive.commit("demo", step_of(number, campaign.planned(run)))
            number += 1
        for seq, block in enumerate(campaign.blocks(run)):
            archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, run), 7, seq, block))
            archive.sync()
    archive.commit("demo", step_of(number, recorder_pb2.RecordingClosed(reason="done")))
    counted = []
    count = windows.count_messages
    monkeypatch.setattr(windows, "count_messages", lambda *given: counted.append(given) or count(*given))
    assert from_record(window(tmp_path, 0.0, 0.5, run="demo.i02").response, field="response")[2].shape == (2, 50)
    assert len(counted) == len(campaign.blocks(RUN))
    # The summary of the file is read once.
    monkeypatch.setattr(signal_windows, "last_metadata", None)
    assert from_record(window(tmp_path, 0.5, 0.5, run="demo.i03").response, field="response")[2].shape == (2, 50)
    with pytest.raises(RefusedError, match=r"it has 'demo\.i01', 'demo\.i02', 'demo\.i03'"):
        window(tmp_path, 0.0, 0.5, run="demo.i04")
