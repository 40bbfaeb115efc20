"""A step that the recorder's disk has no room for: waited for, told, and given up when somebody stops."""

import hashlib
import threading

import pytest

from duralab_bus import FaultError, RecordingLog
from duralab_proto.keys import Keys
from duralab_proto.v1 import query_pb2, recorder_pb2

FULL = "Recording 'demo' cannot be written now (No space left on device)."


class FullDisk:
    """Stands for a bus whose recorder refuses some commits."""

    def __init__(self, *, refused, code=query_pb2.FAULT_CODE_RESOURCE_EXHAUSTED, field=""):
        self.keys = Keys()
        self.refused = refused
        self.fault = FaultError(code, FULL, field=field)
        self.stored = []

    def query(self, key, request, answer, *, longest_seconds, on_progress):
        del key, longest_seconds, on_progress
        if self.refused:
            self.refused -= 1
            raise self.fault
        self.stored.append(request.step)
        payload_hash = hashlib.sha256(request.payload).hexdigest()
        return answer(recording=request.recording, step=request.step, payload_hash=payload_hash)


@pytest.fixture(autouse=True)
def short_wait(monkeypatch):
    monkeypatch.setattr("duralab_bus.commanding.recording_log._ROOM_RETRY_SECONDS", 0.01)


def test_a_step_is_sent_until_there_is_room_and_then_once():
    bus, told = FullDisk(refused=3), []
    log = RecordingLog(bus, "demo", stop=threading.Event(), on_wait=told.append)
    log.commit(recorder_pb2.RunPlanned(run="demo.i01", rig="front"))
    log.commit(recorder_pb2.RunPlanned(run="demo.i02", rig="front"))
    assert bus.stored == [0, 1]
    assert told == [FULL, FULL, FULL, ""]


def test_a_stop_ends_the_wait_with_the_reason():
    bus, stop = FullDisk(refused=10**6), threading.Event()
    log = RecordingLog(bus, "demo", stop=stop, on_wait=lambda _why: stop.set())
    with pytest.raises(FaultError, match="No space left"):
        log.commit(recorder_pb2.RunPlanned(run="demo.i01", rig="front"))
    assert not log.begun


def test_a_step_on_which_the_recorder_works_for_long_is_sent_again_and_one_at_which_it_is_silent_is_not():
    late = query_pb2.FAULT_CODE_DEADLINE_EXCEEDED
    slow = FullDisk(refused=3, code=late, field="longest_seconds")
    RecordingLog(slow, "demo").commit(recorder_pb2.RunPlanned())
    assert slow.stored == [0]
    with pytest.raises(FaultError, match="No space left"):
        RecordingLog(FullDisk(refused=1, code=late), "demo").commit(recorder_pb2.RunPlanned())


def test_who_cannot_be_stopped_does_not_wait():
    with pytest.raises(FaultError, match="No space left"):
        RecordingLog(FullDisk(refused=1), "demo").commit(recorder_pb2.RunPlanned())
