"""A gap in a stream that goes on: given up where nobody has what is missing, waited for where somebody is only slow."""

import struct
import time

import pytest

import duralab_bus
from duralab_bus.streams import repair
from duralab_bus.streams.order import MOST_HELD
from duralab_proto.v1 import rig_pb2

PATIENCE_POLLS = repair.PATIENCE_POLLS


@pytest.fixture
def key(hub):
    return hub.keys.rig_state("r")


@pytest.fixture
def received(hub, key):
    """The numbers that another bus receives, in their order."""
    seqs = []
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="receiver") as bus:
        bus.discover()
        bus.subscribe(key, rig_pb2.RigState, lambda item: seqs.append(item.seq), repair=True)
        time.sleep(0.3)  # The subscription is on its way to the publisher.
        yield seqs


@pytest.fixture
def publish(hub, key, lose):
    """Make a publisher of which some messages are lost; `replay` returns what it replays of what it was asked for."""

    def make(*, lost, replay):
        publisher = hub.publisher(key)
        time.sleep(0.2)  # The offer to replay is on its way to the receiver.
        lose(publisher, lost)
        spool = publisher._spool
        kept = spool.read
        spool.read = lambda first, stop, *, most: replay(kept(first, stop, most=most))
        return publisher

    return make


def test_gap_that_nobody_can_fill_is_given_up_while_the_stream_goes_on(hub, key, received):
    stranger = hub._session.current.declare_publisher(key)
    encoding = duralab_bus.encoding_of(rig_pb2.RigState)
    published = 0
    # Half of what may be held back would take 50 s.
    while len(received) < 2 and published < MOST_HELD // 2:
        if published != 1:
            stranger.put(b"", encoding=encoding, attachment=struct.pack("<QQ", 7, published))
        published += 1
        time.sleep(0.05)
    assert len(received) > PATIENCE_POLLS
    assert received == [0, *range(2, len(received) + 1)]


def test_publisher_that_is_slow_and_has_what_is_missing_is_waited_for_while_the_stream_goes_on(
    publish, received, until
):
    asked = []

    def late(kept):
        asked.append(kept)
        # Longer than anybody waits for what nobody has.
        return kept if len(asked) > 2 * PATIENCE_POLLS else []

    publisher = publish(lost={5, 6, 300}, replay=late)
    published = 0
    while published < 400 or len(asked) <= 2 * PATIENCE_POLLS:
        publisher.put(rig_pb2.RigState())
        published += 1
        time.sleep(0.01)
    until(lambda: len(received) == published)
    assert received == list(range(published))


def test_gap_that_was_given_up_takes_no_patience_from_the_next(publish, received, until, monkeypatch):
    monkeypatch.setattr(repair, "STUCK_POLLS", 3)
    # Its publisher says that it has the first, and cannot read it.
    publisher = publish(lost={1, *range(3, 10, 2)}, replay=lambda kept: [each for each in kept if each.seq != 1])
    for _ in range(3):
        publisher.put(rig_pb2.RigState())
    until(lambda: received == [0, 2])
    for number in range(3, 10, 2):
        # It is asked for in vain meanwhile, every second, as often as anybody is patient.
        time.sleep(2.75 if number % 4 == 1 else 3.25)
        publisher.put(rig_pb2.RigState())
        publisher.put(rig_pb2.RigState())
        until(lambda number=number: len(received) == number + 1)
    assert received == [0, *range(2, 11)]
