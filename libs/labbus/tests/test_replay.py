"""Replay: what a link dropped is asked for again, a receiver that is frozen holds nobody up, memory is bounded."""

import queue
import signal
import threading
import time

import pytest
import zenoh

import labbus
from duralab_proto.v1 import query_pb2, rig_pb2
from labbus import _replay
from labbus._spool import Spool

WAIT = 120.0
RUN = "spooled.1"


class LossyLink:
    """Stands in for the Zenoh publisher under a StreamPublisher and loses some of its messages, as a full link does."""

    def __init__(self, publisher, *, lost):
        self._publisher = publisher
        self._lost = lost
        self._seq = 0

    def put(self, *arguments, **options):
        if self._seq not in self._lost:
            self._publisher.put(*arguments, **options)
        self._seq += 1

    def undeclare(self):
        self._publisher.undeclare()


def publish(bus, key, count, *, lost=(), **options):
    """Publish blocks of which some are lost on the way; return the publisher, open."""
    publisher = bus.publisher(key, **options)
    time.sleep(0.2)  # The offer to replay is on its way to the receiver.
    publisher._publisher = LossyLink(publisher._publisher, lost=lost)
    for number in range(count):
        publisher.put(rig_pb2.SignalBlock(run=RUN, first_sample=number))
    return publisher


@pytest.fixture
def key(hub):
    return hub.keys.rig_signal("r", RUN)


@pytest.fixture
def receiver(hub):
    with labbus.open_bus(labbus.BusConfig(connect=hub.listening), service="receiver") as bus:
        bus.discover()
        yield bus


def test_lost_blocks_are_put_back_in_their_place(hub, receiver, key):
    items = queue.SimpleQueue()
    subscription = receiver.subscribe(hub.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, items.put, repair=True)
    time.sleep(0.3)  # The subscription is on its way to the publisher.
    publish(hub, key, 3000, lost={0, *range(5, 8), *range(100, 2500)})
    received = [items.get(timeout=WAIT) for _ in range(3000)]
    subscription.close()
    assert [item.seq for item in received] == list(range(3000))
    assert [item.message.first_sample for item in received] == list(range(3000))
    assert {item.key for item in received} == {key}
    assert items.empty()


def test_without_repair_a_loss_stays_a_gap(hub, key):
    items = queue.SimpleQueue()
    subscription = hub.subscribe(key, rig_pb2.SignalBlock, items.put)
    publish(hub, key, 4, lost={1, 2})
    assert [items.get(timeout=WAIT).seq for _ in range(2)] == [0, 3]
    subscription.close()


def test_tail_is_replayed_after_the_publisher_closed(hub, receiver, key):
    publisher = publish(hub, key, 2500, lost=range(10, 2500))
    publisher.close()
    items = receiver.replay(key, rig_pb2.SignalBlock, epoch=publisher.epoch, ranges=[range(3, 5), range(10, 2500)])
    assert [item.seq for item in items] == [3, 4, *range(10, 2500)]


def test_each_epoch_on_a_key_is_replayed_by_its_own_publisher(hub, receiver, key):
    first, second = publish(hub, key, 3), publish(hub, key, 5)
    for publisher, count in ((first, 3), (second, 5)):
        items = receiver.replay(key, rig_pb2.SignalBlock, epoch=publisher.epoch, ranges=[range(9)])
        assert [(item.epoch, item.seq) for item in items] == [(publisher.epoch, seq) for seq in range(count)]
    assert receiver.replay(key, rig_pb2.SignalBlock, epoch=1, ranges=[range(9)]) == []


def test_what_fell_out_of_the_spool_stays_missing(hub, receiver, key):
    block = rig_pb2.SignalBlock(run=RUN, first_sample=1)
    publisher = publish(hub, key, 1000, lost=range(1000), spool_bytes=100 * (block.ByteSize() + 128) + 150)
    items = receiver.replay(key, rig_pb2.SignalBlock, epoch=publisher.epoch, ranges=[range(1000)])
    continuity = labbus.Continuity()
    for item in items:
        continuity.accept(item.seq)
    missing = continuity.missing(1000)
    assert [(gap.start, gap.stop) for gap in missing] == [(0, 1000 - len(items))]
    assert 95 <= len(items) <= 101


def test_spool_never_exceeds_its_bound():
    spool = Spool(1000)
    for number in range(50):
        spool.append(bytes(number), "text")
        kept = spool.read(0, 100, most=100)
        assert sum(len(message.payload) + 128 for message in kept) <= 1000
        assert kept[-1].seq == number
    spool.append(bytes(2000), "text")
    assert spool.read(0, 100, most=100) == []


def test_only_the_last_closed_spools_are_kept(hub, receiver, key):
    publishers = [publish(hub, key, 1) for _ in range(_replay.KEPT_SPOOLS + 2)]
    for publisher in publishers:
        publisher.close()
    found = [
        len(receiver.replay(key, rig_pb2.SignalBlock, epoch=publisher.epoch, ranges=[range(1)]))
        for publisher in publishers
    ]
    assert found == [0, 0] + [1] * _replay.KEPT_SPOOLS


def test_closed_spool_is_let_go_after_its_time(hub, receiver, key, monkeypatch):
    monkeypatch.setattr(_replay, "KEPT_SECONDS", 0.2)
    publisher = publish(hub, key, 1)
    publisher.close()
    time.sleep(0.5)
    assert receiver.replay(key, rig_pb2.SignalBlock, epoch=publisher.epoch, ranges=[range(1)]) == []
    assert not hub._replays._offers


@pytest.mark.parametrize("parameters", ["", "?epoch=1", "?epoch=1;first=-1;stop=2", "?epoch=x;first=0;stop=1"])
def test_question_that_is_none_is_refused(hub, receiver, key, parameters):
    publish(hub, key, 1)
    replies = list(
        receiver._session.get(f"{key}/@replay{parameters}", consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0)
    )
    assert len(replies) == 1
    fault = query_pb2.Fault.FromString(replies[0].err.payload.to_bytes())
    assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
    assert "epoch=…;first=…;stop=…" in fault.message


def test_frozen_viewer_holds_up_neither_play_nor_stop_nor_a_receiver_that_repairs(hub, bench, processes):
    viewer = processes.run("viewing_process.py", hub.listening[0])
    hub.wait_for_live({("viewer", "main")}, WAIT)
    received = []
    key = hub.keys.rig_signal("bench", "signals.frozen")
    subscription = hub.subscribe(key, rig_pb2.SignalBlock, received.append, repair=True)
    viewer.send_signal(signal.SIGSTOP)
    stopped = []

    def stop():
        began = time.monotonic()
        hub.query(hub.keys.rig_stop("bench"), rig_pb2.StopRequest(), rig_pb2.RigState)
        stopped.append(time.monotonic() - began)

    stopping = threading.Timer(0.1, stop)
    stopping.start()
    began = time.monotonic()
    # 29 MB: more than all buffers on the way to the viewer hold.
    request = rig_pb2.PlayRequest(run="signals.frozen", seed=3000)
    result = hub.query(hub.keys.rig_play("bench"), request, rig_pb2.PlayResult)
    played = time.monotonic() - began
    stopping.join(WAIT)
    # Zenoh's own patience with a link that takes nothing is 5 s.
    assert played < 4.5
    assert stopped[0] < 4.5
    subscription.close()
    tail = range(received[-1].seq + 1, 3000)
    received += hub.replay(key, rig_pb2.SignalBlock, epoch=result.epoch, ranges=[tail])
    assert [item.seq for item in received] == list(range(3000))
