"""Streams, queries and liveliness between real processes on loopback: a section of `bench.py`.

`python benchmarks/bus.py [--seconds S]` writes it alone; the sustained stream takes S seconds, 60 by default.
"""

import argparse
import contextlib
import itertools
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from enum import Enum, auto
from pathlib import Path
from typing import Any

import numpy as np
import structlog
from bus_peers import Peer, peers
from bus_queries import measure_notice, measure_queries
from google.protobuf.message import Message as ProtobufMessage
from machine import ProcessorTime
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader

import duralab_bus
from duralab_proto.v1 import recorder_pb2

RATE = 5010.0
"""Required rate in blocks of 12.8 KB per second, with a small margin, because a set rate is never quite reached."""
FAULT_RATE = 2000.0
"""Rate for streams with faults: 16 channels at 2 kHz in float64, 100 times as fast as real time."""
PIPE_BLOCKS = 120_000
BURST_RATE = 15_050.0
FREEZE_SECONDS = 8.0
# A fault comes after 2 s, and 5 s are the goal for having caught up.
AFTER_FAULT_SECONDS = 10.0
PIPES = 9
"""Number of pipes of each kind, in turns: on one machine the loss of single pairs scattered from 10 to 38 %."""
BURSTS = 5
"""Number of bursts of each kind, in sequence: bursts of a second scatter by more than a tenth."""


def measure_bus(*, seconds: float = 60.0) -> dict[str, Any]:
    """Measure everything.

    Parameters
    ----------
    seconds : float
        Duration of the sustained stream in s.

    Returns
    -------
    dict
        Rates in blocks of 12.8 KB a second, times in s.
    """
    with tempfile.TemporaryDirectory() as folder, duralab_bus.open_bus(service="hub") as hub:
        path = Path(folder)
        pipe = [[_pipe(hub, path, kind) for kind in PipeKind] for _ in range(PIPES)]
        bare, on_disk, in_memory = np.median(np.array(pipe), axis=0)
        return {
            "sustained": _stream(hub, path, rate=RATE, seconds=seconds),
            "sustained_bare": _bare_stream(hub, path, rate=RATE, seconds=seconds),
            "burst": _middle([_stream(hub, path, rate=BURST_RATE, seconds=1.0) for _ in range(BURSTS)]),
            "burst_bare": _middle([_bare_stream(hub, path, rate=BURST_RATE, seconds=1.0) for _ in range(BURSTS)]),
            "pipe": {
                "bare_rate": float(bare),
                "rate_spool_on_disk": float(on_disk),
                "share_lost_spool_on_disk": float(1.0 - on_disk / bare),
                "rate_spool_in_memory": float(in_memory),
                "share_lost_spool_in_memory": float(1.0 - in_memory / bare),
            },
            "frozen_receiver": _stream(
                hub, path, rate=FAULT_RATE, seconds=FREEZE_SECONDS + AFTER_FAULT_SECONDS, fault=_freeze
            ),
            "killed_receiver": _stream(hub, path, rate=FAULT_RATE, seconds=AFTER_FAULT_SECONDS, fault=_kill),
            "real_recorder": _recorder(hub, path, rate=RATE, seconds=seconds / 4.0),
            "queries": measure_queries(hub),
            "noticed": measure_notice(hub),
        }


class PipeKind(Enum):
    """Kind of pipe between a publisher and an MCAP file."""

    BARE = auto()
    SPOOL_ON_DISK = auto()
    SPOOL_IN_MEMORY = auto()


def _pipe(hub: duralab_bus.Bus, folder: Path, kind: PipeKind) -> float:
    """Return the maximum rate of a pipe from publisher to MCAP file."""
    bare = kind is PipeKind.BARE
    prefix = "bare_" if bare else ""
    run = f"pipe-{time.time_ns()}"
    common = {"endpoint": hub.listening[0], "run": run}
    with peers() as start:
        receiver = start(f"{prefix}receive", file=str(folder / "pipe.mcap"), **common)
        receiver.read()
        spool_folder = str(folder / run) if kind is PipeKind.SPOOL_ON_DISK else ""
        spool = {} if bare else {"spool": spool_folder, "rate": 0.0, "seconds": 0.0}
        publisher = start(f"{prefix}publish", most=PIPE_BLOCKS, **spool, **common)
        epoch = publisher.read()["epoch"]
        began = time.time()
        receiver.tell(str(epoch))
        receiver.tell(str(PIPE_BLOCKS))
        return PIPE_BLOCKS / (receiver.read()["complete_at"] - began)


def _middle(bursts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the burst with the median rate, and the rates of all bursts."""
    bursts.sort(key=lambda burst: burst["rate"])
    return {**bursts[len(bursts) // 2], "rates": [burst["rate"] for burst in bursts]}


def _bare_stream(hub: duralab_bus.Bus, folder: Path, *, rate: float, seconds: float) -> dict[str, float]:
    """Publish at a rate with Zenoh alone, to a receiver that writes all blocks: the machine's limit."""
    common = {"endpoint": hub.listening[0], "run": f"bare-{time.time_ns()}"}
    with peers() as start:
        receiver = start("bare_receive", file=str(folder / "bare.mcap"), **common)
        receiver.read()
        publisher = start("bare_publish", rate=rate, most=round(rate * seconds), **common)
        publisher.read()
        with ProcessorTime() as processors:
            publisher.tell("")
            published = publisher.read()
    return {
        "rate": published["blocks"] / published["seconds"],
        "longest_put": published["longest_put"],
        "stolen_share": processors.stolen_share,
    }


Fault = Callable[[Callable[[], Peer], Peer], tuple[Peer, float]]


def _freeze(restart: Callable[[], Peer], receiver: Peer) -> tuple[Peer, float]:
    """Freeze the receiver for some time; return it and the time of its return."""
    del restart
    receiver.process.send_signal(signal.SIGSTOP)
    time.sleep(FREEZE_SECONDS)
    receiver.process.send_signal(signal.SIGCONT)
    return receiver, time.time()


def _kill(restart: Callable[[], Peer], receiver: Peer) -> tuple[Peer, float]:
    """Kill the receiver and start another that resumes what was not marked."""
    receiver.end()
    return restart(), time.time()


def _stream(
    hub: duralab_bus.Bus, folder: Path, *, rate: float, seconds: float, fault: Fault | None = None
) -> dict[str, Any]:
    """Stream at a rate and count the received blocks; with a fault 2 s after the begin."""
    common = {"endpoint": hub.listening[0], "run": f"stream-{time.time_ns()}"}
    files: list[Path] = []
    with peers() as start:

        def receive() -> Peer:
            files.append(folder / f"{time.time_ns()}.mcap")
            peer = start("receive", file=str(files[-1]), **common)
            peer.read()
            return peer

        receiver = receive()
        publisher = start("publish", rate=rate, seconds=seconds, spool=str(folder / common["run"]), **common)
        epoch = str(publisher.read()["epoch"])
        receiver.tell(epoch)
        back_at = 0.0
        if fault is not None:
            time.sleep(2.0)
            after, back_at = fault(receive, receiver)
            if after is not receiver:
                after.tell(epoch)
            receiver = after
        with ProcessorTime() as processors:
            receiver.tell("complete")
            complete_at = receiver.read()["complete_at"]
        publisher.tell("")
        published = publisher.read()
        receiver.tell("end")
        figures = {
            "rate_asked": rate,
            "rate": published["blocks"] / published["seconds"],
            "blocks": published["blocks"],
            **_counted(receiver.read(), published["blocks"], files),
            "longest_put": published["longest_put"],
            "put_p999": published["put_p999"],
            "stolen_share": processors.stolen_share,
            "waited_for_room": published["waited"],
            "complete_after_last_block": complete_at - published["ended_at"],
        }
    if fault is not None:
        figures["caught_up"] = _caught_up(published["unmarked"], back_at, rate=rate)
    for file in files:
        file.unlink()
    return figures


def _recorder(hub: duralab_bus.Bus, folder: Path, *, rate: float, seconds: float) -> dict[str, Any]:
    """Stream at a rate into a recording of the recorder service itself, and have it verified."""
    config = folder / "recorder.json"  # which is YAML as well
    settings = {"bus": {"connect": list(hub.listening)}, "folder": str(folder / "recordings"), "live_file": False}
    config.write_text(json.dumps(settings), encoding="utf-8")
    while hub.live("recorder"):
        time.sleep(0.05)
    run, keys = f"bench-{time.time_ns()}", hub.keys
    service = subprocess.Popen([sys.executable, "-m", "recorder", "--config", str(config)], stderr=subprocess.DEVNULL)
    hub.wait_for_live({("recorder", "main")}, 60.0)
    steps = itertools.count()

    def commit(message: ProtobufMessage) -> None:
        request = recorder_pb2.CommitRequest(
            recording=run,
            step=next(steps),
            message_type=message.DESCRIPTOR.full_name,
            payload=message.SerializeToString(deterministic=True),
        )
        hub.query(keys.commit(), request, recorder_pb2.CommitAck)

    try:
        with peers() as start:
            commit(recorder_pb2.RunPlanned(run=run, rig="bench"))
            publisher = start(
                "publish", endpoint=hub.listening[0], run=run, rate=rate, seconds=seconds, spool=str(folder / run)
            )
            epoch = publisher.read()["epoch"]
            publisher.tell("")
            published = publisher.read()
            began = time.monotonic()
            commit(recorder_pb2.RunPlayed(run=run, rig="bench", epoch=epoch, blocks=published["blocks"]))
            waited = time.monotonic() - began
            commit(recorder_pb2.RecordingClosed(reason="measured"))
            info = hub.query(keys.recording(run), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo)
            verified = hub.query(
                keys.recording_verify(run), recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult
            )
    finally:
        service.terminate()
        service.wait()
        shutil.rmtree(folder / "recordings", ignore_errors=True)
    return {
        "rate": published["blocks"] / published["seconds"],
        "blocks": published["blocks"],
        "missing": info.missing_blocks,
        "stored": info.signal_blocks,
        "whole": verified.whole,
        "longest_put": published["longest_put"],
        "waited_for_room": published["waited"],
        "complete_after_last_block": waited,
    }


def _counted(received: dict[str, Any], published: int, files: list[Path]) -> dict[str, int]:
    """Count what is lost, doubled and out of order; over all files where a receiver was killed."""
    several = len(files) > 1
    different = len(set().union(*(_sequences(file) for file in files))) if several else received["different"]
    return {
        "lost": published - different,
        "doubled": received["received"] - received["different"],
        "reordered": received["reordered"],
    }


def _sequences(file: Path) -> set[int]:
    """Return the numbers in a file, which may have no end."""
    found = set()
    with file.open("rb") as stream, contextlib.suppress(McapError):
        for record in StreamReader(stream).records:
            if isinstance(record, Message):
                found.add(record.sequence)
    return found


def _caught_up(unmarked: list[tuple[float, int]], back_at: float, *, rate: float) -> float:
    """Return after how many seconds what is not on the receiver's disk is what one second makes, or less.

    Where it was never so, what is returned is the time that was watched, which is longer than the goal.
    """
    last, _ = unmarked[-1]
    return next((when for when, blocks in unmarked if when > back_at and blocks < rate), last) - back_at


if __name__ == "__main__":
    # Standard output is for the figures.
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    parser = argparse.ArgumentParser(description="Measure streams, queries and liveliness on loopback.")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the sustained stream")
    sys.stdout.write(json.dumps(measure_bus(seconds=parser.parse_args().seconds), indent=2) + "\n")
