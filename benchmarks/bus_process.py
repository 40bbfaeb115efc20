"""Processes measured by `bus.py`: publishers and receivers, with duralab_bus and with Zenoh alone.

Each takes its settings as one JSON text, says `ready` when it may begin, and writes its figures as JSON at its end.
"""

import json
import os
import queue
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import structlog
import zenoh
from mcap.writer import CompressionType, Writer

import duralab_bus
from duralab_proto.arrays import to_array
from duralab_proto.v1 import query_pb2, rig_pb2

CHANNELS, SAMPLES = 8, 100
SYNC_SECONDS = 0.25
SYNC_BLOCKS = 3000
MOST_AHEAD = 8000
"""Maximum number of blocks that a publisher without a set rate may be ahead of its receiver."""

KEY = "duralab/v1/local/rig/bench/signal/{run}"
POSITION = struct.Struct("<QQ")


def main() -> None:
    """Play the role of the settings."""
    # Standard output is for the benchmark.
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    settings = json.loads(sys.argv[1])
    figures = ROLES[settings.pop("role")](**settings)
    say(json.dumps(figures))


def say(line: str) -> None:
    """Send a line to the benchmark."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def block(run: str, number: int, drive: Any, response: Any) -> rig_pb2.SignalBlock:
    """Return a block of 12.8 KB of samples: eight drives and eight responses, as a rig with that many makes them."""
    return rig_pb2.SignalBlock(
        run=run, first_sample=number * SAMPLES, sample_rate=2000.0, drive=to_array(drive), response=to_array(response)
    )


def publish(*, endpoint: str, run: str, rate: float, seconds: float, spool: str, most: int = 0) -> dict[str, Any]:
    """Publish at a rate, or at full speed if it is 0, for a number of seconds or blocks; wait for space."""
    drive, response = np.random.default_rng(1).standard_normal((2, CHANNELS, SAMPLES))
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(endpoint,)), service="rig_sim") as bus:
        bus.wait_for_live({("recorder", "main")}, 60.0)
        # On disk where a folder is given, in memory otherwise.
        spools = duralab_bus.SpoolFolder(Path(spool)) if spool else duralab_bus.SpoolSpace(512 * 2**20)
        publisher = bus.publisher(KEY.format(run=run), spools=spools, durable=True)
        time.sleep(1.0)
        say(json.dumps({"epoch": publisher.epoch}))
        stalls, waited, number = [], 0.0, 0
        unmarked, next_look = [], 0.0
        began = time.monotonic()
        while (number < most) if most else (time.monotonic() - began < seconds):
            while publisher.shortage or (not rate and publisher.unmarked > MOST_AHEAD):
                time.sleep(0.001)
                waited += 0.001
            message = block(run, number, drive, response)
            before = time.monotonic()
            publisher.put(message)
            stalls.append(time.monotonic() - before)
            number += 1
            if before > next_look:
                unmarked.append((time.time(), publisher.unmarked))
                next_look = before + 0.05
            if rate and (ahead := number / rate - (time.monotonic() - began)) > 0.002:
                time.sleep(ahead)
        took = time.monotonic() - began
        ended_at = time.time()
        publisher.close()
        sys.stdin.readline()  # Its spool is served until the receiver has all.
    return {
        "blocks": number,
        "seconds": took,
        "ended_at": ended_at,
        "longest_put": max(stalls),
        "put_p999": float(np.quantile(stalls, 0.999)),
        "waited": waited,
        "unmarked": unmarked,
    }


def receive(*, endpoint: str, run: str, file: str) -> dict[str, Any]:
    """Write a stream to an MCAP file like a recorder; end on request and return the received numbers."""
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(endpoint,)), service="recorder") as bus:
        writing = McapWriting(Path(file))
        subscription = bus.subscribe(
            KEY.format(run=run),
            rig_pb2.SignalBlock,
            lambda item: writing.put(item.payload, item.seq, item.position),
            repair=True,
        )
        writing.stored = subscription.mark
        bus.declare_live("recorder", "main")
        say("ready")
        epoch = int(sys.stdin.readline())
        # Each line requests the time at which a part was written, or at which it was known to be complete.
        for line in map(str.strip, sys.stdin):
            if line == "end":
                break
            if line.isdigit():
                writing.wait_for(int(line))
            else:
                while not subscription.proof(KEY.format(run=run), epoch).complete:
                    time.sleep(0.002)
            say(json.dumps({"complete_at": time.time()}))
        subscription.close()
        return {**writing.close(), "replayed": subscription.fetched}


class McapWriting:
    """One writer thread: 1 MiB chunks, on the disk four times a second."""

    def __init__(self, path: Path) -> None:
        self.stored: Callable[[list[tuple[str, int, int]]], None] | None = None
        self._queue: queue.Queue[tuple[bytes, int, Any] | None] = queue.Queue(4096)
        self._stream = path.open("wb")
        self._writer = Writer(self._stream, chunk_size=2**20, compression=CompressionType.LZ4)
        self._writer.start()
        schema = self._writer.register_schema("none", "", b"")
        self._channel = self._writer.register_channel("blocks", "protobuf", schema)
        self._seqs: list[int] = []
        self.last_at = 0.0
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def put(self, payload: bytes, seq: int, position: Any) -> None:
        """Queue a block; waits where the disk is too slow."""
        self._queue.put((payload, seq, position))

    def wait_for(self, blocks: int) -> None:
        """Wait until this number of blocks is written."""
        while len(self._seqs) < blocks:
            time.sleep(0.002)

    def close(self) -> dict[str, Any]:
        """Write the rest; return how many came, and how."""
        self._queue.put(None)
        self._thread.join()
        self._writer.finish()
        self._stream.close()
        seqs = np.array(self._seqs)
        return {
            "received": len(seqs),
            "different": len(np.unique(seqs)),
            "reordered": int((np.diff(seqs) < 0).sum()),
            "highest": int(seqs.max(initial=-1)),
            "last_at": self.last_at,
        }

    def _run(self) -> None:
        due, positions = time.monotonic() + SYNC_SECONDS, []
        while True:
            try:
                entry = self._queue.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                entry = ()
            if entry is None:
                return
            if entry:
                payload, seq, position = entry
                now = time.time_ns()
                self._writer.add_message(self._channel, now, payload, now, seq)
                self._seqs.append(seq)
                positions.append(position)
                self.last_at = time.time()
            if len(positions) >= SYNC_BLOCKS or time.monotonic() >= due:
                self._writer.flush()
                os.fsync(self._stream.fileno())
                if self.stored is not None and positions:
                    self.stored(positions)
                positions = []
                due = time.monotonic() + SYNC_SECONDS


def bare_session(endpoint: str) -> zenoh.Session:
    """Open a plain session beside a hub."""
    config = {
        "mode": "peer",
        "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def bare_publish(*, endpoint: str, run: str, rate: float = 0.0, most: int) -> dict[str, Any]:
    """Publish blocks with Zenoh alone: as fast as a blocking link takes them, or at a rate as duralab_bus sends."""
    drive, response = np.random.default_rng(1).standard_normal((2, CHANNELS, SAMPLES))
    congestion = zenoh.CongestionControl.DROP if rate else zenoh.CongestionControl.BLOCK
    with bare_session(endpoint) as session:
        publisher = session.declare_publisher(KEY.format(run=run), congestion_control=congestion)
        time.sleep(1.5)
        say(json.dumps({"epoch": 1}))
        stalls = []
        began = time.monotonic()
        for number in range(most):
            message = block(run, number, drive, response)
            before = time.monotonic()
            publisher.put(message.SerializeToString(), attachment=POSITION.pack(1, number))
            stalls.append(time.monotonic() - before)
            if rate and (ahead := (number + 1) / rate - (time.monotonic() - began)) > 0.002:
                time.sleep(ahead)
        took = time.monotonic() - began
        sys.stdin.readline()
    return {"blocks": most, "seconds": took, "longest_put": max(stalls)}


def bare_receive(*, endpoint: str, run: str, file: str) -> dict[str, Any]:
    """Write received blocks to an MCAP file, with Zenoh and mcap alone."""
    with bare_session(endpoint) as session:
        writing = McapWriting(Path(file))
        samples: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()

        def pass_on() -> None:
            while True:
                sample = samples.get()
                writing.put(sample.payload.to_bytes(), POSITION.unpack(sample.attachment.to_bytes())[1], None)

        threading.Thread(target=pass_on, daemon=True).start()
        subscriber = session.declare_subscriber(
            KEY.format(run=run), zenoh.handlers.Callback(samples.put, indirect=False)
        )
        say("ready")
        sys.stdin.readline()
        writing.wait_for(int(sys.stdin.readline()))
        say(json.dumps({"complete_at": time.time()}))
        sys.stdin.readline()
        subscriber.undeclare()
        return writing.close()


def serve(*, endpoint: str) -> dict[str, Any]:
    """Answer queries on a rig's keys: at once, and with 2 MB."""
    bulk = to_array(np.zeros(250_000))
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(endpoint,)), service="rig_sim") as bus:
        bus.serve(bus.keys.rig_state("bench"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState(rig="bench"))
        bus.serve(
            bus.keys.rig_description("bench"),
            rig_pb2.DescriptionRequest,
            lambda *_: rig_pb2.RigDescription(static_response=bulk),
        )

        def wait(*_: object) -> query_pb2.Progress:
            threading.Event().wait()
            raise AssertionError

        bus.serve(bus.keys.rig_frf("bench"), rig_pb2.RigFrfRequest, wait)
        bus.declare_live("rig_sim", "bench")
        say("ready")
        sys.stdin.readline()
    return {}


ROLES: dict[str, Callable[..., dict[str, Any]]] = {
    "publish": publish,
    "receive": receive,
    "bare_publish": bare_publish,
    "bare_receive": bare_receive,
    "serve": serve,
}

if __name__ == "__main__":
    main()
