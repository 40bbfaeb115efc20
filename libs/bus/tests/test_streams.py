"""Streams: everything arrives once and in order, and what is damaged is reported."""

import queue
import struct
import threading

import pytest

import duralab_bus
from duralab_proto.keys import run_of
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0


def test_five_thousand_blocks_from_another_process_are_contiguous(lab, until):
    items = []
    key = lab.keys.rig_signal("bench", "signals.1")
    subscription = lab.subscribe(lab.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, items.append, repair=True)
    request = rig_pb2.PlayRequest(run="signals.1", seed=5000)
    result = lab.query(lab.keys.rig_play("bench"), request, rig_pb2.PlayResult)
    until(lambda: subscription.proof(key, result.epoch).complete)
    subscription.close()
    assert {item.epoch for item in items} == {result.epoch}
    assert [item.seq for item in items] == list(range(5000))
    assert [item.message.first_sample for item in items] == list(range(0, 500_000, 100))
    assert {run_of(item.key) for item in items} == {"signals.1"}


def test_each_publisher_has_a_later_epoch(lab):
    first, second = lab.publisher(lab.keys.rig_pose("bench")), lab.publisher(lab.keys.rig_pose("bench"))
    assert first.epoch < second.epoch
    assert first.put(rig_pb2.PoseBlock()) == 0
    assert first.put(rig_pb2.PoseBlock()) == 1
    assert second.put(rig_pb2.PoseBlock()) == 0
    first.close()
    with pytest.raises(duralab_bus.BusError, match="closed"):
        first.put(rig_pb2.PoseBlock())


def test_threads_sharing_a_publisher_stay_in_order(hub):
    items = queue.SimpleQueue()
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="sender") as sender:
        subscription = hub.subscribe(hub.keys.rig_pose("r"), rig_pb2.PoseBlock, items.put)
        publisher = sender.publisher(hub.keys.rig_pose("r"))
        first = until_first(publisher, items)
        threads = [
            threading.Thread(target=lambda: [publisher.put(rig_pb2.PoseBlock()) for _ in range(100)]) for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        seqs = [items.get(timeout=WAIT).seq for _ in range(400)]
        # The first messages may have been sent before the subscription was known to the sender.
        assert seqs[-1] == publisher.put(rig_pb2.PoseBlock()) - 1
        assert seqs == list(range(first + 1, seqs[-1] + 1))
        subscription.close()


def until_first(publisher, items):
    """Publish until a message arrives, and return the number of the last one published."""
    while True:
        last = publisher.put(rig_pb2.PoseBlock())
        try:
            seq = items.get(timeout=0.2).seq
        except queue.Empty:
            continue
        while seq < last:
            seq = items.get(timeout=WAIT).seq
        return last


def test_damaged_messages_are_reported_and_the_stream_goes_on(hub):
    items, problems = queue.SimpleQueue(), queue.SimpleQueue()
    key = hub.keys.rig_state("r")
    subscription = hub.subscribe(key, rig_pb2.RigState, items.put, problems.put)
    right = duralab_bus.encoding_of(rig_pb2.RigState)
    position = struct.pack("<QQ", 7, 0)
    for payload, encoding, attachment, said in [
        (b"\xff", right, position, "not a duralab.v1.RigState"),
        (b"", "text/plain", position, "expected is 'application/protobuf;duralab.v1.RigState'"),
        (b"", right, b"short", "5 bytes of epoch"),
        (b"", right, None, "0 bytes of epoch"),
    ]:
        hub._session.current.put(key, payload, encoding=encoding, attachment=attachment)
        problem = problems.get(timeout=WAIT)
        assert said in problem.message
        assert key in problem.message
        assert problem.code in (query_pb2.FAULT_CODE_INVALID_ARGUMENT, query_pb2.FAULT_CODE_DATA_LOSS)
    hub._session.current.put(key, rig_pb2.RigState(rig="r").SerializeToString(), encoding=right, attachment=position)
    item = items.get(timeout=WAIT)
    assert (item.key, item.epoch, item.seq, item.message.rig) == (key, 7, 0, "r")
    subscription.close()
    assert items.empty()


def test_callback_that_raises_does_not_end_the_subscription(hub):
    items = queue.SimpleQueue()

    def fail_first(item):
        items.put(item.seq)
        if item.seq == 0:
            raise RuntimeError("the first one fails")

    subscription = hub.subscribe(hub.keys.rig_state("r"), rig_pb2.RigState, fail_first)
    publisher = hub.publisher(hub.keys.rig_state("r"))
    publisher.put(rig_pb2.RigState())
    publisher.put(rig_pb2.RigState())
    assert [items.get(timeout=WAIT) for _ in range(2)] == [0, 1]
    subscription.close()


def test_closing_delivers_what_had_arrived(hub):
    items = []
    gate = threading.Event()

    def slow(item):
        gate.wait(WAIT)
        items.append(item.seq)

    subscription = hub.subscribe(hub.keys.rig_state("r"), rig_pb2.RigState, slow)
    publisher = hub.publisher(hub.keys.rig_state("r"))
    for _ in range(50):
        publisher.put(rig_pb2.RigState())
    gate.set()
    subscription.close()
    assert items == list(range(50))
