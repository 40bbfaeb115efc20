"""A rig gateway as a stranger would write it from docs/contract.md: Zenoh, the generated messages, and nothing of ours.

`python foreign_gateway.py ENDPOINT` serves the rig `stranger`: two cylinders on a beam, stiff at its ends and soft
in between, with bump stops; it prints `ready` and runs until its standard input ends.
"""

from __future__ import annotations

import struct
import sys
import threading
import time

import numpy as np
import zenoh
from google.protobuf.message import Message

from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2

ROOT = "duralab/v1/local"
RIG = "stranger"
RATE = 200.0
BLOCK = 100
WAITING = "waiting for the operator to press start"
DRIVES = [array_pb2.Channel(name=f"{side}_cylinder", unit="m", minimum=-0.05, maximum=0.05) for side in ("a", "b")]
RESPONSES = [array_pb2.Channel(name=f"{side}_force", unit="N", minimum=-1e5, maximum=1e5) for side in ("a", "b")]


def encoding(message: Message) -> str:
    """Return the encoding of a message as the contract writes it."""
    return f"application/protobuf;{message.DESCRIPTOR.full_name}"


def array(values: np.ndarray) -> array_pb2.Array:
    """Encode an array of float64.

    Parameters
    ----------
    values : ndarray
        Of any shape.

    Returns
    -------
    array_pb2.Array
        Little-endian, in C order.
    """
    return array_pb2.Array(
        element_type=array_pb2.ELEMENT_TYPE_FLOAT64, shape=values.shape, data=values.astype("<f8").tobytes()
    )


def beam(drive: np.ndarray) -> np.ndarray:
    """Return the forces of the two cylinders: coupled stiffness that hardens, and damping.

    Parameters
    ----------
    drive : (drives, samples)
        Strokes in m.

    Returns
    -------
    ndarray, (responses, samples)
        Forces in N.
    """
    stiffness = np.array([[4.0e5, -0.8e5], [-0.6e5, 3.0e5]])
    speed = np.diff(drive, prepend=0.0, axis=1) * RATE
    return stiffness @ (drive + 40.0 * drive**3) + 600.0 * speed


class Stranger:
    """The rig: what it is, what it does now, what it has played."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.lock = threading.Lock()
        self.run, self.latched, self.played = "", "", set()
        # Every block that was published, by (run, epoch): what a full link drops is asked for again.
        self.kept: dict[tuple[str, int], list[bytes]] = {}
        handlers = {
            "description": lambda query: self.answer(query, self.description()),
            "state": lambda query: self.answer(query, self.state()),
            "stop": self.stop,
            "reset": self.reset,
            "play": lambda query: threading.Thread(target=self.play, args=(query,), daemon=True).start(),
        }
        # Kept, because Zenoh takes back what nobody holds.
        self.served = [
            session.declare_queryable(f"{ROOT}/rig/{RIG}/{name}", handler) for name, handler in handlers.items()
        ]
        self.served.append(session.declare_queryable(f"{ROOT}/rig/{RIG}/signal/*/@replay", self.replay))
        # Last: whoever sees the token may ask.
        self.token = session.liveliness().declare_token(f"{ROOT}/live/rig_sim/{RIG}")

    def answer(self, query: zenoh.Query, message: Message) -> None:
        """Answer a query, and end it."""
        with query:
            query.reply(query.key_expr, message.SerializeToString(), encoding=encoding(message))

    def refuse(self, query: zenoh.Query, code: query_pb2.FaultCode, message: str, field: str = "") -> None:
        """Answer a query with a fault, and end it."""
        fault = query_pb2.Fault(code=code, message=message, field=field, service="stranger")
        with query:
            query.reply_err(fault.SerializeToString(), encoding=encoding(fault))

    def description(self) -> rig_pb2.RigDescription:
        """Return what the rig is."""
        return rig_pb2.RigDescription(
            rig=RIG,
            specimen="a beam on two cylinders",
            engine="somebody's own",
            version="0.1",
            sample_rate=RATE,
            drives=DRIVES,
            responses=RESPONSES,
            longest_drive_seconds=300.0,
            static_response=array(np.zeros(2)),
            block_samples=BLOCK,
            content_hash="beam-1",
        )

    def state(self) -> rig_pb2.RigState:
        """Return what it does now."""
        mode = rig_pb2.RIG_MODE_PLAYING if self.run else rig_pb2.RIG_MODE_IDLE
        if self.latched:
            mode = rig_pb2.RIG_MODE_INTERLOCKED
        return rig_pb2.RigState(rig=RIG, mode=mode, reason=self.latched, run=self.run)

    def stop(self, query: zenoh.Query) -> None:
        """Latch."""
        self.latched = rig_pb2.StopRequest.FromString(query.payload.to_bytes()).reason or "stopped"
        self.answer(query, self.state())

    def reset(self, query: zenoh.Query) -> None:
        """Clear the latch."""
        self.latched = ""
        self.answer(query, self.state())

    def play(self, query: zenoh.Query) -> None:
        """Check a drive, play it, publish its blocks and answer."""
        request = rig_pb2.PlayRequest.FromString(query.payload.to_bytes())
        names = [channel.name for channel in request.drive.channels]
        given = request.drive.samples
        if names != [channel.name for channel in DRIVES] or request.drive.sample_rate != RATE:
            self.refuse(query, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "Other channels or another rate.", "drive")
            return
        drive = np.frombuffer(given.data, dtype="<f8").reshape(tuple(given.shape))
        if not np.all(np.abs(drive) <= 0.05):
            self.refuse(query, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "Beyond ± 0.05 m.", "drive.samples")
            return
        with self.lock:
            if self.latched:
                self.refuse(query, query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"Latched: {self.latched}.")
                return
            if request.run in self.played:
                self.refuse(query, query_pb2.FAULT_CODE_ALREADY_EXISTS, "That run was played.", "run")
                return
            if self.run:
                self.refuse(query, query_pb2.FAULT_CODE_BUSY, f"Run {self.run} plays.")
                return
            self.run = request.run
            self.played.add(request.run)
        waiting = query_pb2.Progress(phase=WAITING, remaining_seconds=-1.0)
        query.reply(query.key_expr, waiting.SerializeToString(), encoding=encoding(waiting))
        response, epoch = beam(drive), time.time_ns()
        blocks = self.publish(request.run, drive, response, epoch)
        result = rig_pb2.PlayResult(run=request.run, epoch=epoch, blocks=blocks, real_time_factor=1.0)
        result.response.channels.extend(RESPONSES)
        result.response.sample_rate = RATE
        result.response.samples.CopyFrom(array(response))
        self.run = ""
        self.answer(query, result)

    def publish(self, run: str, drive: np.ndarray, response: np.ndarray, epoch: int) -> int:
        """Publish the blocks of a run, each with its number; return how many."""
        publisher = self.session.declare_publisher(
            f"{ROOT}/rig/{RIG}/signal/{run}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_LOW,
        )
        firsts = range(0, drive.shape[1], BLOCK)
        kept = self.kept[run, epoch] = []
        for number, first in enumerate(firsts):
            block = rig_pb2.SignalBlock(
                run=run,
                first_sample=first,
                sample_rate=RATE,
                drive=array(drive[:, first : first + BLOCK]),
                response=array(response[:, first : first + BLOCK]),
                last=first + BLOCK >= drive.shape[1],
            )
            kept.append(block.SerializeToString())
            publisher.put(kept[-1], encoding=encoding(block), attachment=struct.pack("<QQ", epoch, number))
        publisher.undeclare()
        return len(firsts)

    def replay(self, query: zenoh.Query) -> None:
        """Send again the blocks that somebody missed."""
        asked = {name: int(query.parameters.get(name)) for name in ("epoch", "first", "stop")}
        run = str(query.key_expr).split("/")[-2]
        key = str(query.key_expr).removesuffix("/@replay")
        kept = self.kept.get((run, asked["epoch"]), [])
        with query:
            for number in range(asked["first"], min(asked["stop"], len(kept))):
                query.reply(
                    key,
                    kept[number],
                    encoding=encoding(rig_pb2.SignalBlock()),
                    attachment=struct.pack("<QQ", asked["epoch"], number),
                )


def main() -> None:
    """Join the lab at the endpoint and serve until standard input ends."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
    # Where no lab is, it ends.
    config.insert_json5("connect/timeout_ms", "5000")
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        rig = Stranger(session)
        sys.stdout.write(f"ready {rig.description().rig}\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
