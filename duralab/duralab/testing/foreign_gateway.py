"""Rig gateway written only from docs/contract.md: it uses Zenoh and the generated messages, and no code of Duralab.

`python foreign_gateway.py ENDPOINT` serves the rig `stranger`: two cylinders on a beam, stiff at its ends and soft
in between, with bump stops. A run continues to its end and is published after it, as its description states. The
program prints `ready` and runs until its standard input ends.
"""

from __future__ import annotations

import hashlib
import re
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
LIMIT = 0.05
WAITING = "waiting for the operator to press start"
DRIVES = [
    array_pb2.Channel(
        name=f"{side}_cylinder", unit="m", kind=array_pb2.CHANNEL_KIND_DISPLACEMENT, minimum=-LIMIT, maximum=LIMIT
    )
    for side in ("a", "b")
]
RESPONSES = [
    array_pb2.Channel(name=f"{side}_force", unit="N", kind=array_pb2.CHANNEL_KIND_FORCE, minimum=-1e5, maximum=1e5)
    for side in ("a", "b")
]


def encoding(message: Message) -> str:
    """Return the encoding of a message in the form of the contract."""
    return f"application/protobuf;{message.DESCRIPTOR.full_name}"


def payload(query: zenoh.Query) -> bytes:
    """Return the payload of a query; an empty message if there is none."""
    return b"" if query.payload is None else query.payload.to_bytes()


def array(values: np.ndarray) -> array_pb2.Array:
    """Encode an array of float64."""
    return array_pb2.Array(
        element_type=array_pb2.ELEMENT_TYPE_FLOAT64, shape=values.shape, data=values.astype("<f8").tobytes()
    )


def beam(drive: np.ndarray) -> np.ndarray:
    """Return the forces of the two cylinders: coupled stiffness that hardens, and damping."""
    stiffness = np.array([[4.0e5, -0.8e5], [-0.6e5, 3.0e5]])
    speed = np.diff(drive, prepend=0.0, axis=1) * RATE
    return stiffness @ (drive + 40.0 * drive**3) + 600.0 * speed


class RefusedError(Exception):
    """Refusal of a request: one sentence, and the field."""

    def __init__(
        self, sentence: str, field: str = "", *, code: query_pb2.FaultCode = query_pb2.FAULT_CODE_INVALID_ARGUMENT
    ) -> None:
        super().__init__(sentence)
        self.field, self.code = field, code


class Stranger:
    """Rig with its description, its present state and its played runs."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.lock = threading.Condition()
        self.run, self.latched, self.played = "", "", set()
        self.epoch, self.states = time.time_ns(), 0
        # Published blocks, by (run, epoch): a subscriber requests blocks that a full link dropped.
        self.kept: dict[tuple[str, int], list[bytes]] = {}
        handlers = {
            "description": lambda query: self.answer(query, self.description()),
            "state": lambda query: self.answer(query, self.state()),
            "stop": self.stop,
            # Slow requests run in a thread, so that a stop is handled meanwhile.
            "reset": lambda query: threading.Thread(target=self.reset, args=(query,), daemon=True).start(),
            "play": lambda query: threading.Thread(target=self.play, args=(query,), daemon=True).start(),
        }
        self.publisher = session.declare_publisher(f"{ROOT}/rig/{RIG}/state")
        # Keep references, because Zenoh undeclares objects without a reference.
        self.served = [
            session.declare_queryable(f"{ROOT}/rig/{RIG}/{name}", handler) for name, handler in handlers.items()
        ]
        self.served.append(session.declare_queryable(f"{ROOT}/rig/{RIG}/signal/*/@replay", self.replay))
        # Declared last: a client that sees the token may send requests.
        self.token = session.liveliness().declare_token(f"{ROOT}/live/rig_sim/{RIG}")

    def answer(self, query: zenoh.Query, message: Message) -> None:
        """Answer a query, and end it."""
        with query:
            query.reply(query.key_expr, message.SerializeToString(), encoding=encoding(message))

    def refuse(self, query: zenoh.Query, refused: RefusedError) -> None:
        """Answer a query with a fault, and end it."""
        fault = query_pb2.Fault(code=refused.code, message=str(refused), field=refused.field, service="stranger")
        with query:
            query.reply_err(fault.SerializeToString(), encoding=encoding(fault))

    def description(self) -> rig_pb2.RigDescription:
        """Return the description of the rig."""
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
            content_hash=hashlib.sha256(b"beam-1").hexdigest(),
            publishes_after_run=True,
            cannot_be_stopped=True,
            simulated=True,
        )

    def state(self) -> rig_pb2.RigState:
        """Return the present state."""
        mode = rig_pb2.RIG_MODE_PLAYING if self.run else rig_pb2.RIG_MODE_IDLE
        if self.latched:
            mode = rig_pb2.RIG_MODE_INTERLOCKED
        return rig_pb2.RigState(rig=RIG, mode=mode, reason=self.latched, run=self.run)

    def change(self, **values: str) -> None:
        """Change the state and publish it."""
        with self.lock:
            vars(self).update(values)
            self.lock.notify_all()
            state = self.state()
            place = struct.pack("<QQ", self.epoch, self.states)
            self.publisher.put(state.SerializeToString(), encoding=encoding(state), attachment=place)
            self.states += 1

    def stop(self, query: zenoh.Query) -> None:
        """Latch the rig; the answer names the run that continues."""
        self.change(latched=rig_pb2.StopRequest.FromString(payload(query)).reason or "stopped")
        self.answer(query, self.state())

    def reset(self, query: zenoh.Query) -> None:
        """Clear the latch when the rig is at rest."""
        with self.lock:
            self.lock.wait_for(lambda: not self.run)
            self.change(latched="")
        self.answer(query, self.state())

    def checked(self, request: rig_pb2.PlayRequest) -> np.ndarray:
        """Return the drive of a request; raise RefusedError if it is not allowed."""
        given = request.drive
        channels = [(channel.name, channel.unit) for channel in given.channels]
        if not re.fullmatch(r"[a-z0-9][a-z0-9_.-]*", request.run):
            raise RefusedError(f"{request.run!r} is no name of a run.", "run")
        if given.sample_rate != RATE:
            raise RefusedError(f"{given.sample_rate:g} Hz; I play {RATE:g} Hz.", "drive.sample_rate")
        if channels != [(channel.name, channel.unit) for channel in DRIVES]:
            raise RefusedError("Other channels or units than those of my description.", "drive.channels")
        drive = np.frombuffer(given.samples.data, dtype="<f8").reshape(tuple(given.samples.shape))
        if drive.shape[1] == 0 or not np.all(np.abs(drive) <= LIMIT):
            raise RefusedError(f"No samples, or some beyond ± {LIMIT:g} m.", "drive.samples")
        return drive

    def begin(self, run: str) -> None:
        """Reserve the rig for a run; raise RefusedError if it is not free."""
        with self.lock:
            if self.latched:
                raise RefusedError(f"Latched: {self.latched}.", code=query_pb2.FAULT_CODE_FAILED_PRECONDITION)
            if run in self.played:
                raise RefusedError("That run was played.", "run", code=query_pb2.FAULT_CODE_ALREADY_EXISTS)
            if self.run:
                raise RefusedError(f"Run {self.run} plays.", code=query_pb2.FAULT_CODE_BUSY)
            self.played.add(run)
            self.change(run=run)

    def play(self, query: zenoh.Query) -> None:
        """Check a drive, play it, publish its blocks and answer."""
        request = rig_pb2.PlayRequest.FromString(payload(query))
        try:
            drive = self.checked(request)
            self.begin(request.run)
        except RefusedError as refused:
            self.refuse(query, refused)
            return
        rest = drive.shape[1] / RATE if request.real_time else 0.0
        self.report(query, rest)
        while rest > 0.0:
            time.sleep(min(rest, 0.5))
            rest -= 0.5
            self.report(query, max(rest, 0.0))
        response, epoch = beam(drive), time.time_ns()
        blocks = self.publish(request.run, drive, response, epoch)
        result = rig_pb2.PlayResult(run=request.run, epoch=epoch, blocks=blocks, real_time_factor=1.0)
        result.response.channels.extend(RESPONSES)
        result.response.sample_rate = RATE
        result.response.samples.CopyFrom(array(response))
        result.actuators.extend(rig_pb2.ActuatorUse(drive=channel.name) for channel in DRIVES)
        self.change(run="")
        self.answer(query, result)

    def report(self, query: zenoh.Query, rest: float) -> None:
        """Send progress, so that the client does not report a silent rig."""
        waiting = query_pb2.Progress(phase=WAITING, remaining_seconds=rest or -1.0)
        query.reply(query.key_expr, waiting.SerializeToString(), encoding=encoding(waiting))

    def publish(self, run: str, drive: np.ndarray, response: np.ndarray, epoch: int) -> int:
        """Publish the blocks of a run, each with its number; return the number of blocks."""
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
        """Send the blocks that a subscriber missed again."""
        asked = {name: int(query.parameters.get(name) or 0) for name in ("epoch", "first", "stop")}
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
    # End the program if there is no lab at the endpoint.
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
