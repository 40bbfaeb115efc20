"""The list of recordings, of files that nobody writes any more."""

from __future__ import annotations

import shutil
from unittest import mock

import numpy as np
import pytest

from duralab_bus import Call
from duralab_proto.arrays import to_array
from duralab_proto.v1 import iterator_pb2, recorder_pb2
from recorder.config import RecorderConfig
from recorder.refused import RefusedError
from recorder.service import RecorderService


@pytest.fixture
def service(tmp_path):
    found = RecorderService(RecorderConfig(folder=tmp_path, live_file=False, least_free_mebibytes=0))
    yield found
    found.close()


def listed(service):
    call = mock.create_autospec(Call, instance=True)
    found = service.list_recordings(recorder_pb2.ListRecordingsRequest(), call).recordings
    return {information.recording: information for information in found}


def test_a_file_that_is_no_whole_recording_and_that_nobody_writes_is_not_said_to_be_written(
    service, tmp_path, campaign, request_of
):
    call = mock.create_autospec(Call, instance=True)
    for number, message in enumerate([campaign.specification(), campaign.description()]):
        service.commit(mock.Mock(), request_of(number, message), call)
    # Put there while the recorder runs; it takes up what it finds when it starts.
    shutil.copy(tmp_path / "demo.mcap", tmp_path / "cut.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "text.mcap").write_bytes(b"hello, this is no recording")
    found = listed(service)
    assert {name: (one.closed, one.ended, one.steps) for name, one in found.items()} == {
        "demo": (False, False, 2),
        "cut": (True, False, 2),
        "empty": (True, False, 0),
        "text": (True, False, 0),
    }


@pytest.mark.parametrize("verdict", [iterator_pb2.PRE_TEST_VERDICT_PASSED, iterator_pb2.PRE_TEST_VERDICT_FAILED])
def test_a_pre_test_is_listed_with_its_rig_and_verdict_also_by_another_recorder(
    service, tmp_path, campaign, request_of, verdict
):
    call, description = mock.create_autospec(Call, instance=True), campaign.description()
    shape = (len(description.responses), len(description.drives))
    found = iterator_pb2.PreTest(
        id="demo",
        verdict=verdict,
        drives=description.drives,
        responses=description.responses,
        peak=to_array(np.ones(shape)),
        response=to_array(np.zeros((shape[0], 9), dtype=np.float32)),
    )
    steps = [iterator_pb2.PreTestRequest(id="demo", rig="bench"), description, found, recorder_pb2.RecordingClosed()]
    said = []
    for number, message in enumerate(steps):
        service.commit(mock.Mock(), request_of(number, message), call)
        said.append((listed(service)["demo"].rig, listed(service)["demo"].pre_test))
    unfinished = iterator_pb2.PRE_TEST_VERDICT_UNFINISHED
    assert said == [("bench", unfinished), ("bench", unfinished), ("bench", verdict), ("bench", verdict)]
    service.close()
    other = RecorderService(RecorderConfig(folder=tmp_path, live_file=False, least_free_mebibytes=0))
    try:
        assert (listed(other)["demo"].rig, listed(other)["demo"].pre_test) == ("bench", verdict)
    finally:
        other.close()


def test_a_damaged_pre_test_is_refused(service, campaign, request_of):
    call, description = mock.create_autospec(Call, instance=True), campaign.description()
    for message, field in (
        (iterator_pb2.PreTestRequest(id="demo", rig="No Rig"), "payload.rig"),
        (iterator_pb2.PreTest(drives=description.drives, peak=to_array(np.ones((3, 3)))), "payload.peak"),
    ):
        with pytest.raises(RefusedError) as caught:
            service.commit(mock.Mock(), request_of(0, message), call)
        assert caught.value.field == field


def test_a_recording_whose_writing_begins_while_it_is_described_is_said_to_be_written(
    service, campaign, request_of, monkeypatch
):
    call = mock.create_autospec(Call, instance=True)
    service.commit(mock.Mock(), request_of(0, campaign.specification()), call)
    information, calls = service._archive.information, iter([None])
    monkeypatch.setattr(service._archive, "information", lambda name: next(calls, information(name)))
    assert not listed(service)["demo"].closed
