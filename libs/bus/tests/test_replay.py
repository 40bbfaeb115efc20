"""Replay: what a link dropped is asked for again, a receiver that is frozen holds nobody up, memory is bounded."""

import math
import queue
import signal
import struct
import threading
import time

import pytest
import zenoh

import duralab_bus
from duralab_bus.spool.spool import Spool
from duralab_bus.streams import replay
from duralab_bus.streams.repair import FOLLOWED_STREAMS
from duralab_bus.streams.subscription import MOST_WAITING
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0
RUN = "spooled.1"


@pytest.fixture
def publish(lose):
    """Publish blocks of which some are lost on the way; return the publisher, open."""

    def put(bus, key, count, *, lost=(), **options):
        publisher = bus.publisher(key, **options)
        time.sleep(0.2)  # The offer to replay is on its way to the receiver.
        lose(publisher, lost)
        for number in range(count):
            publisher.put(rig_pb2.SignalBlock(run=RUN, first_sample=number))
        return publisher

    return put


@pytest.fixture
def key(hub):
    return hub.keys.rig_signal("r", RUN)


@pytest.fixture
def receiver(hub):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="receiver") as bus:
        bus.discover()
        yield bus


def test_lost_blocks_are_put_back_in_their_place(hub, receiver, key, publish):
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


def test_without_repair_a_loss_stays_a_gap(hub, key, publish):
    items = queue.SimpleQueue()
    subscription = hub.subscribe(key, rig_pb2.SignalBlock, items.put)
    publish(hub, key, 4, lost={1, 2})
    assert [items.get(timeout=WAIT).seq for _ in range(2)] == [0, 3]
    subscription.close()


def test_tail_is_replayed_after_the_publisher_closed(hub, receiver, key, until, publish):
    publisher = publish(hub, key, 2500, lost=range(10, 2500))
    publisher.close()
    items = []
    # Nothing is published any more: only its head tells that there is something.
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: subscription.proof(key, publisher.epoch).complete)
    assert [item.seq for item in items] == list(range(2500))
    subscription.close()


def test_each_epoch_on_a_key_is_replayed_by_its_own_publisher(hub, receiver, key, until, publish):
    publishers = {publish(hub, key, count).epoch: count for count in (3, 5)}
    items = []
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: len(items) == 8)
    for epoch, count in publishers.items():
        assert [item.seq for item in items if item.epoch == epoch] == list(range(count))
        assert subscription.proof(key, epoch).next == count
    assert subscription.proof(key, 1).next == 0
    subscription.close()


def test_all_runs_of_a_rig_are_offered_by_one_declaration_and_each_is_replayed_by_itself(hub, receiver, until, publish):
    runs = {hub.keys.rig_signal("r", f"run.{number}"): number for number in range(1, 6)}
    publishers = {key: publish(hub, key, 10 * number, lost=range(3, 10)) for key, number in runs.items()}
    # Nothing is undeclared with a run, and so nothing declared again with the next: Zenoh would keep it all.
    publish(hub, hub.keys.rig_signal("other", "run.1"), 1)
    assert list(hub._replays._families) == [hub.keys.rig_signal("r", "*"), hub.keys.rig_signal("other", "*")]
    items = []
    receiver.subscribe(hub.keys.rig_signal("r", "*"), rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: len(items) == 150)
    for key, number in runs.items():
        assert [(item.epoch, item.seq) for item in items if item.key == key] == [
            (publishers[key].epoch, seq) for seq in range(10 * number)
        ]


def test_payload_is_the_bytes_that_were_published(hub, receiver, key, until, publish):
    publish(hub, key, 3)
    items = []
    receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: len(items) == 3)
    assert [rig_pb2.SignalBlock.FromString(item.payload) for item in items] == [item.message for item in items]
    assert [item.position[2] for item in items] == [0, 1, 2]


def test_what_fell_out_of_the_spool_is_told_as_lost(hub, receiver, key, until, publish):
    block = rig_pb2.SignalBlock(run=RUN, first_sample=1)
    # Where nobody marks, one stream takes an eighth of its space.
    space = duralab_bus.SpoolSpace(8 * (100 * (block.ByteSize() + 128) + 150))
    items = []
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    first = publish(hub, key, 1)
    until(lambda: len(items) == 1)
    publisher = publish(hub, key, 1000, lost=range(1000), spools=space)
    publisher.close()
    until(lambda: subscription.proof(key, publisher.epoch).done)
    until(lambda: not subscription.proof(key, publisher.epoch).missing)
    proof = subscription.proof(key, publisher.epoch)
    received = [item.seq for item in items if item.epoch == publisher.epoch]
    assert received == list(range(1000 - len(received), 1000))
    assert 90 <= len(received) <= 101
    assert proof.lost == (range(1000 - len(received)),)
    assert not proof.complete
    assert first.epoch != publisher.epoch
    subscription.close()


def test_gap_that_nobody_can_fill_delays_what_follows_but_does_not_keep_it(hub, receiver, key, until):
    items = []
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    # A publisher that keeps nothing and answers nobody, such as a gateway of somebody else.
    encoding = duralab_bus.encoding_of(rig_pb2.SignalBlock)
    stranger = hub._session.current.declare_publisher(key)
    block = rig_pb2.SignalBlock(run=RUN).SerializeToString()
    until(lambda: stranger.matching_status.matching)
    for seq in (0, 1, 4, 5):
        stranger.put(block, encoding=encoding, attachment=struct.pack("<QQ", 7, seq))
    subscription.expect(key, 7, 8)
    until(lambda: len(items) == 4)
    assert [item.seq for item in items] == [0, 1, 4, 5]
    proof = subscription.proof(key, 7)
    assert (proof.received, proof.done, proof.complete) == (4, True, False)
    assert proof.missing == (range(2, 4), range(6, 8))
    # It turns up late: delivered all the same, once.
    stranger.put(block, encoding=encoding, attachment=struct.pack("<QQ", 7, 2))
    stranger.put(block, encoding=encoding, attachment=struct.pack("<QQ", 7, 2))
    stranger.put(block, encoding=encoding, attachment=struct.pack("<QQ", 7, 6))
    until(lambda: len(items) >= 6)
    assert [item.seq for item in items] == [0, 1, 4, 5, 2, 6]
    subscription.close()


def test_spool_that_nobody_marks_never_exceeds_its_bound():
    spool = Spool(duralab_bus.SpoolSpace(10**6).store(key="k", epoch=1), held=False, unheld_bytes=1000)
    for number in range(50):
        spool.append(bytes(number), "text")
        kept = spool.read(0, 100, most=100)
        assert sum(len(message.payload) + 128 for message in kept) <= 1000
        assert kept[-1].seq == number
    spool.append(bytes(2000), "text")
    assert spool.read(0, 100, most=100) == []


def test_spool_that_is_marked_refuses_rather_than_dropping():
    space = duralab_bus.SpoolSpace(10 * 228)
    spool = Spool(space.store(key="k", epoch=1), held=True, unheld_bytes=0)
    while not spool.shortage:
        spool.append(bytes(100), "text")
    assert spool.extent.next == 9  # Seven eighths of ten.
    assert "MiB in memory is full" in spool.shortage
    for _ in range(2):
        spool.append(bytes(100), "text")
    with pytest.raises(duralab_bus.SpoolFullError, match="11 messages not stored"):
        spool.append(bytes(100), "text")
    assert [message.seq for message in spool.read(0, 100, most=100)] == list(range(11))
    spool.mark(6)
    assert not spool.shortage
    assert spool.append(bytes(100), "text") == 11
    assert [message.seq for message in spool.read(0, 100, most=100)] == list(range(6, 12))
    spool.mark(3)
    assert spool.extent.marked == 6
    spool.mark(99)
    assert spool.settled
    assert space.used_bytes == 0


def test_only_the_last_closed_spools_are_kept_where_nobody_marks(hub, receiver, key, until, publish):
    publishers = [publish(hub, key, 1) for _ in range(replay.KEPT_SPOOLS + 2)]
    for publisher in publishers:
        publisher.close()
    assert len(hub._replays._offers) == replay.KEPT_SPOOLS
    items = []
    receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: len(items) == replay.KEPT_SPOOLS)
    assert {item.epoch for item in items} == {publisher.epoch for publisher in publishers[2:]}


def test_closed_spool_is_let_go_after_its_time(hub, key, monkeypatch, until, publish):
    monkeypatch.setattr(replay, "KEPT_SECONDS", 0.2)
    publisher = publish(hub, key, 1)
    publisher.close()
    until(lambda: not hub._replays._offers)


def test_marks_free_the_spool_and_who_marks_is_waited_for(hub, receiver, key, until, publish):
    space = duralab_bus.SpoolSpace(2**20)
    publisher = publish(hub, key, 100, lost=range(20, 30), spools=space)
    items = []
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    until(lambda: len(items) == 100)
    assert space.used_bytes > 0
    subscription.mark(item.position for item in items if item.seq != 50)
    until(lambda: publisher.unmarked == 50)
    publisher.close()
    assert hub._replays._offers  # Not marked: kept, however long it takes.
    subscription.mark([items[50].position])
    until(lambda: space.used_bytes == 0)
    until(lambda: subscription.proof(key, publisher.epoch).complete)
    until(lambda: not hub._replays._offers)
    subscription.close()


def test_mark_of_what_was_never_published_frees_nothing(hub, receiver, key, until, publish):
    publisher = publish(hub, key, 3)
    client = receiver._replay_client
    until(lambda: client.mark(key, epoch=publisher.epoch, stored=1) or publisher.unmarked == 2)
    client.mark(key, epoch=publisher.epoch, stored=2**63)
    client.mark(key, epoch=publisher.epoch + 1, stored=3)
    receiver._session.current.put(f"{key}/@mark", b"\xff\xff", encoding="text/plain")
    until(lambda: client.mark(key, epoch=publisher.epoch, stored=2) or publisher.unmarked == 1)


def test_strangers_do_not_make_a_stream_forgotten(hub, receiver, key, until, publish):
    items = []
    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, items.append, repair=True)
    publisher = publish(hub, key, 3)
    until(lambda: subscription.proof(key, publisher.epoch).next == 3 and len(items) == 3)
    until(lambda: not math.isinf(subscription._repair._streams[key, publisher.epoch].heard))
    for epoch in range(2 * FOLLOWED_STREAMS):
        subscription._repair.take([duralab_bus.StreamItem(key, epoch, 5, rig_pb2.SignalBlock())], replayed=False)
    assert len(subscription._repair._streams) == FOLLOWED_STREAMS
    assert subscription.proof(key, publisher.epoch).received == 3
    subscription.close()


def test_spool_is_held_from_the_start_where_a_recorder_was_met(hub, key, until):
    assert not hub.publisher(key, durable=True)._spool.held
    token = hub.declare_live("recorder", "main")
    until(lambda: hub.publisher(key, durable=True)._spool.held)
    assert not hub.publisher(key)._spool.held
    token.close()


def test_slow_receiver_gets_everything_and_memory_stays_bounded(hub, receiver, key, until, publish):
    gate, seqs = threading.Event(), []

    def slow(item):
        gate.wait(WAIT)
        seqs.append(item.seq)

    subscription = receiver.subscribe(key, rig_pb2.SignalBlock, slow, repair=True)
    publisher = publish(hub, key, 3 * MOST_WAITING)
    gate.set()
    publisher.close()
    until(lambda: subscription.proof(key, publisher.epoch).complete)
    assert seqs == list(range(3 * MOST_WAITING))
    subscription.close()


@pytest.mark.parametrize("parameters", ["", "?epoch=1", "?epoch=1;first=-1;stop=2", "?epoch=x;first=0;stop=1"])
def test_question_that_is_none_is_refused(hub, receiver, key, parameters, publish):
    publish(hub, key, 1)
    replies = list(
        receiver._session.current.get(
            f"{key}/@replay{parameters}", consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0
        )
    )
    assert len(replies) == 1
    fault = query_pb2.Fault.FromString(replies[0].err.payload.to_bytes())
    assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
    assert "epoch=…;first=…;stop=…" in fault.message


def test_frozen_viewer_holds_up_neither_play_nor_stop_nor_a_receiver_that_repairs(hub, bench, processes, until):
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
    until(lambda: subscription.proof(key, result.epoch).complete)
    subscription.close()
    assert [item.seq for item in received] == list(range(3000))
