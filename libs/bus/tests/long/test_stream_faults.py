"""Streams under faults, between real processes: whatever dies, freezes or is cut, every message is stored once."""

import json
import signal
import socket
import subprocess
import threading
from contextlib import contextmanager, suppress

import pytest

import duralab_bus
from duralab_proto.v1 import rig_pb2

COUNT = 3000


@pytest.fixture
def spool(tmp_path):
    return tmp_path / "spool"


@pytest.fixture
def publish(hub, processes, spool):
    """Start a publisher; return its process and epoch."""

    def start(*, count=COUNT, pause=0.0005, closes=True, endpoint=None, **more):
        settings = {"endpoint": endpoint or hub.listening[0], "spool": str(spool), "count": count, "pause": pause}
        process = processes.run(
            "publishing_process.py",
            json.dumps({**settings, "closes": closes, **more}),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        return process, int(process.stdout.readline())

    return start


class Storing:
    """A receiver and the file that it writes; a line is the epoch and number of a message."""

    def __init__(self, hub, processes, path):
        self.file = path / "stored.txt"
        self.file.touch()
        self._hub, self._processes = hub, processes
        self.start()

    def start(self):
        self.process = self._processes.run("storing_process.py", self._hub.listening[0], str(self.file))

    def stored(self, epoch):
        lines = self.file.read_text().splitlines()
        return [int(line.split()[1]) for line in lines if line.split()[0] == str(epoch) and len(line.split()) == 2]


@pytest.fixture
def storing(hub, processes, tmp_path):
    storing = Storing(hub, processes, tmp_path)
    hub.wait_for_live({("recorder", "main")}, 120.0)
    return storing


def left(spool):
    return list(spool.glob("*/*.spool"))


def test_killed_receiver_leaves_what_it_did_not_store_to_the_next(publish, storing, spool, until):
    publisher, epoch = publish()
    until(lambda: len(storing.stored(epoch)) > COUNT // 4)
    storing.process.kill()
    storing.process.wait()
    before = storing.stored(epoch)
    storing.start()
    until(lambda: set(storing.stored(epoch)) == set(range(COUNT)))
    assert before == list(range(len(before)))
    # What the first had stored and not marked comes again, in order and once.
    after = storing.stored(epoch)[len(before) :]
    assert after == list(range(after[0], COUNT))
    assert after[0] <= len(before)
    until(lambda: not left(spool))
    assert publisher.poll() is None


def test_frozen_receiver_gets_what_went_past_it_when_it_thaws(publish, storing, spool, until):
    _, epoch = publish(count=20_000, pause=0.0)
    until(lambda: len(storing.stored(epoch)) > 100)
    storing.process.send_signal(signal.SIGSTOP)
    # All of it is published, far more than every buffer on the way holds, and longer than a link is kept.
    until(lambda: not storing._hub.live("recorder"))
    storing.process.send_signal(signal.SIGCONT)
    until(lambda: len(storing.stored(epoch)) >= 20_000)
    assert storing.stored(epoch) == list(range(20_000))
    until(lambda: not left(spool))


def test_spool_of_a_killed_publisher_is_served_by_the_next(hub, publish, storing, spool, until):
    storing.process.send_signal(signal.SIGSTOP)
    until(lambda: not hub.live("recorder"))
    # The receiver has none of it when the publisher dies.
    publisher, epoch = publish(closes=False, pause=0.0)
    until(lambda: left(spool))
    until(lambda: sum(path.stat().st_size for path in left(spool)) > COUNT * 5000)
    publisher.kill()
    publisher.wait()
    storing.process.send_signal(signal.SIGCONT)
    hub.wait_for_live({("recorder", "main")}, 120.0)
    _, second = publish(count=10)
    until(lambda: len(storing.stored(second)) == 10)
    until(lambda: len(storing.stored(epoch)) > COUNT // 2)
    until(lambda: not left(spool))
    stored = storing.stored(epoch)
    assert stored == list(range(len(stored)))


@contextmanager
def cutting_proxy(endpoint):
    """Pass a connection on, and cut it when told: yields the endpoint to connect to, and `cut`."""
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    open_sockets, lock, ended = set(), threading.Lock(), threading.Event()

    def pump(source, sink):
        try:
            while data := source.recv(65536):
                sink.sendall(data)
        except OSError:
            pass
        cut_one(source)
        cut_one(sink)

    def cut_one(connection):
        with lock:
            open_sockets.discard(connection)
        with suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)
        connection.close()

    def accept():
        while not ended.is_set():
            try:
                here, _ = listener.accept()
                there = socket.create_connection((host, int(port)))
            except OSError:
                continue
            with lock:
                open_sockets.update((here, there))
            for pair in ((here, there), (there, here)):
                threading.Thread(target=pump, args=pair, daemon=True).start()

    def cut():
        with lock:
            connections = list(open_sockets)
        for connection in connections:
            cut_one(connection)
        return len(connections)

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(0.1)
        accepting = threading.Thread(target=accept)
        accepting.start()
        yield f"tcp/127.0.0.1:{listener.getsockname()[1]}", cut
        ended.set()
        accepting.join()
        cut()


def test_cut_connections_lose_nothing(hub, publish, until):
    seqs = []
    key = hub.keys.rig_signal("bench", "faults.1")
    subscription = hub.subscribe(key, rig_pb2.SignalBlock, lambda item: seqs.append(item.seq), repair=True)
    with cutting_proxy(hub.listening[0]) as (endpoint, cut):
        # A client talks through this one connection only; peers would find another way.
        _, epoch = publish(endpoint=endpoint, mode="client", count=2 * COUNT)
        for share in (0.2, 0.4, 0.6):
            until(lambda share=share: len(seqs) > share * COUNT)
            assert cut() > 0
        until(lambda: subscription.proof(key, epoch).complete)
        subscription.close()
    assert seqs == list(range(2 * COUNT))


def test_stream_ends_in_a_proof_only_when_its_publisher_said_so(hub, publish, until):
    seqs = []
    key = hub.keys.rig_signal("bench", "faults.1")
    subscription = hub.subscribe(key, rig_pb2.SignalBlock, lambda item: seqs.append(item.seq), repair=True)
    _, epoch = publish(count=10, closes=False)
    until(lambda: len(seqs) == 10)
    assert not subscription.proof(key, epoch).complete
    subscription.expect(key, epoch, 10)
    assert subscription.proof(key, epoch) == duralab_bus.StreamProof(
        received=10, next=10, done=True, missing=(), lost=()
    )
    assert subscription.proof(key, epoch).complete
    subscription.close()
