"""Stream messages that cannot be read, nor their like in the spool: told once, and they hold up nothing."""

import struct
import time

import pytest

import duralab_bus
from duralab_proto.v1 import rig_pb2

LARGEST_BYTES = 2000
OTHER = rig_pb2.StopRequest(reason="of another type")
TOO_LARGE = rig_pb2.RigState(reason="x" * 2 * LARGEST_BYTES)
EPOCH = 7


@pytest.fixture
def key(hub):
    return hub.keys.rig_state("r")


@pytest.fixture
def receiver(hub):
    config = duralab_bus.BusConfig(connect=hub.listening, largest_payload_bytes=LARGEST_BYTES)
    with duralab_bus.open_bus(config, service="receiver") as bus:
        bus.discover()
        yield bus


class Receiving:
    """A subscription with repair, what it delivered, and what it told of."""

    def __init__(self, bus, key, *, marks=False):
        self.items, self.problems, self.marks = [], [], marks
        self.subscription = bus.subscribe(key, rig_pb2.RigState, self._take, self.problems.append, repair=True)
        time.sleep(0.3)  # The subscription is on its way to the publisher.

    def _take(self, item):
        self.items.append(item)
        if self.marks:
            self.subscription.mark([item.position])

    @property
    def seqs(self):
        return [item.seq for item in self.items]


@pytest.fixture
def publish(lose):
    """Publish messages of which some are lost on the way; return the publisher, open."""

    def put(bus, key, messages, *, lost=()):
        publisher = bus.publisher(key)
        time.sleep(0.2)  # The offer to replay is on its way to the receiver.
        lose(publisher, lost)
        for message in messages:
            publisher.put(message)
        return publisher

    return put


def states(count, refused):
    """Return states, with others in the place of some."""
    return [refused.get(number, rig_pb2.RigState(rig="r")) for number in range(count)]


@pytest.fixture
def stranger(hub, key):
    """Publishes by position, and keeps nothing."""
    publisher = hub._session.current.declare_publisher(key)
    encoding = duralab_bus.encoding_of(rig_pb2.RigState)

    def put(seq, *, readable=True):
        payload = rig_pb2.RigState(rig="r").SerializeToString() if readable else b"\xff"
        publisher.put(payload, encoding=encoding, attachment=struct.pack("<QQ", EPOCH, seq))

    yield put
    publisher.undeclare()


# What the links lose comes by replay, the rest as it is published: the first, the last, some in between, two in a row.
@pytest.mark.parametrize("lost", [(), range(300), {0, 50, 51, 299}, {49, 52, 298}])
def test_refused_messages_are_lost_and_all_others_come_in_order(hub, receiver, key, lost, publish, until):
    refused = {0: OTHER, 50: OTHER, 51: TOO_LARGE, 200: TOO_LARGE, 299: OTHER}
    receiving = Receiving(receiver, key, marks=True)
    publisher = publish(hub, key, states(300, refused), lost=lost)
    began = time.monotonic()
    until(lambda: len(receiving.items) == 295)
    assert receiving.seqs == [number for number in range(300) if number not in refused]
    until(lambda: receiving.subscription.proof(key, publisher.epoch).next == 300)
    until(lambda: not receiving.subscription.proof(key, publisher.epoch).missing)
    # What lay behind a refused message was waited for, for 10 s and more.
    assert time.monotonic() - began < 5.0
    # Its spool is let go, all of it.
    until(lambda: publisher.unmarked == 0)
    publisher.close()
    until(lambda: receiving.subscription.proof(key, publisher.epoch).done)
    proof = receiving.subscription.proof(key, publisher.epoch)
    assert proof.lost == (range(1), range(50, 52), range(200, 201), range(299, 300))
    assert (proof.received, proof.missing, proof.complete) == (295, (), False)
    assert receiving.subscription.lost == 5
    assert receiving.subscription.missing == 0
    assert len(receiving.problems) == 5
    assert all(key in problem.message for problem in receiving.problems)
    receiving.subscription.close()


def test_message_that_was_spoilt_on_its_way_is_told_once_and_comes_from_its_spool(hub, receiver, key, publish, until):
    receiving = Receiving(receiver, key)
    publisher = publish(hub, key, states(3, {}))
    spoilt = {"encoding": duralab_bus.encoding_of(rig_pb2.RigState)}
    for seq in (3, 4, 3, 3):
        attachment = struct.pack("<QQ", publisher.epoch, seq)
        hub._session.current.put(key, b"\xff", attachment=attachment, **spoilt)
    until(lambda: len(receiving.problems) == 2)
    for message in states(3, {}):
        publisher.put(message)
    until(lambda: len(receiving.items) == 6)
    publisher.close()
    until(lambda: receiving.subscription.proof(key, publisher.epoch).complete)
    assert receiving.seqs == list(range(6))
    assert receiving.subscription.lost == 0
    assert len(receiving.problems) == 2
    receiving.subscription.close()


def test_refused_message_of_which_nobody_has_another_is_left_out_and_the_order_kept(receiver, key, stranger, until):
    receiving = Receiving(receiver, key)
    for seq, readable in ((0, True), (2, False), (3, True), (4, False)):
        stranger(seq, readable=readable)
    until(lambda: len(receiving.problems) == 2)
    assert receiving.seqs == [0]
    stranger(1)
    stranger(5)
    until(lambda: len(receiving.items) == 4)
    assert receiving.seqs == [0, 1, 3, 5]
    receiving.subscription.close()


def test_refused_number_that_cannot_be_holds_up_nothing_and_ends_with_its_stream(
    hub, receiver, key, publish, lose, until
):
    receiving = Receiving(receiver, key, marks=True)
    publisher = publish(hub, key, states(3, {}))
    until(lambda: len(receiving.items) == 3)
    encoding = duralab_bus.encoding_of(rig_pb2.RigState)
    for seq in (2**63, 2**64 - 1):
        attachment = struct.pack("<QQ", publisher.epoch, seq)
        hub._session.current.put(key, b"\xff", encoding=encoding, attachment=attachment)
    until(lambda: len(receiving.problems) == 2)
    # Every other one is lost on its way: they are put back in their place as before.
    lose(publisher, range(0, 100, 2))
    for message in states(100, {}):
        publisher.put(message)
    until(lambda: len(receiving.items) == 103)
    assert receiving.seqs == list(range(103))
    until(lambda: publisher.unmarked == 0)
    publisher.close()
    until(lambda: receiving.subscription.proof(key, publisher.epoch).complete)
    receiving.subscription.close()


def test_stream_of_which_all_is_refused_is_let_go_where_its_receiver_stores(hub, receiver, key, until):
    space = duralab_bus.SpoolSpace(2**20)
    publisher = hub.publisher(key, spools=space)
    receiving = Receiving(receiver, key)
    for _ in range(100):
        publisher.put(OTHER)
    until(lambda: len(receiving.problems) == 100)
    assert publisher.unmarked == 100
    receiving.subscription.mark([])
    until(lambda: publisher.unmarked == 0)
    assert space.used_bytes == 0
    assert receiving.subscription.proof(key, publisher.epoch).lost == (range(100),)
    receiving.subscription.close()


def test_message_without_a_position_is_told_and_no_part_of_any_stream(hub, receiver, key, publish, until):
    receiving = Receiving(receiver, key)
    publisher = publish(hub, key, states(3, {}))
    for attachment in (None, b"short", b"\x00" * 24):
        hub._session.current.put(key, b"\xff", encoding="text/plain", attachment=attachment)
    until(lambda: len(receiving.problems) == 3)
    publisher.close()
    until(lambda: receiving.subscription.proof(key, publisher.epoch).complete)
    assert receiving.seqs == [0, 1, 2]
    assert receiving.subscription.lost == 0
    receiving.subscription.close()
