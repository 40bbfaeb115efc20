"""Malformed messages on every stream of the contract while a campaign runs, and on what streams are repaired with."""

from __future__ import annotations

import struct

import numpy as np
import zenoh
from google.protobuf.message import Message

from duralab_bus import Bus, FaultError, encoding_of
from duralab_proto.v1 import rig_pb2, stream_pb2

from .keys_of_contract import contract_keys, odd_name_in
from .lab_under_fault import RIG
from .malformed import Malformation, malformed
from .raw_session import raw_session
from .reference import Reference
from .templates import template

_POSITION = struct.Struct("<QQ")
_LARGEST = 2**64 - 1
_NOBODY = "nobody"
_ASKED_EVERY = 20
_FALSE_PARAMETERS = (
    "",
    "epoch=1",
    "epoch=x;first=0;stop=1",
    "epoch=1;first=-1;stop=5",
    f"epoch={_LARGEST};first=0;stop={_LARGEST}",
    f"epoch=1;first=0;stop={10**40}",
    "epoch=1;first=5;stop=1",
    "epoch=1;first=0;stop=" + "9" * 5000,
)


def publish_malformed(bus: Bus, reference: Reference, endpoint: str, *, random: np.random.Generator, each: int) -> int:
    """Publish so many malformed messages of each kind on each stream, also that of the run that plays now.

    Returns
    -------
    int
        How many were sent.
    """
    sent = 0
    with raw_session(endpoint) as session:
        for key in (key for key in contract_keys(bus.keys) if key.stream):
            sound = template(key.kind, reference.recording)
            for malformation in Malformation:
                run = _NOBODY
                for number in range(each):
                    if number % _ASKED_EVERY == 0:
                        run = _run_now(bus)
                    names = {"rig": RIG, "run": run, "id": _NOBODY}
                    where = key.make(*(names[name] for name in key.names))
                    if number % _ASKED_EVERY == 1:
                        where = odd_name_in(where, key, random)
                    session.put(
                        where,
                        malformed(sound, malformation, random),
                        encoding=_odd_encoding(sound, random),
                        attachment=_odd_position(random),
                        congestion_control=zenoh.CongestionControl.BLOCK,
                    )
                    sent += 1
            sent += _disturb_repair(session, where, random=random, each=each)
    return sent


def _disturb_repair(session: zenoh.Session, stream: str, *, random: np.random.Generator, each: int) -> int:
    """Send malformed marks, and ask malformed questions for replays and heads, as the last stream's receiver would."""
    marks = stream_pb2.StreamMark(epoch=1, next=_LARGEST)
    for number in range(each):
        malformation = list(Malformation)[number % len(Malformation)]
        session.put(f"{stream}/@mark", malformed(marks, malformation, random), encoding=_odd_encoding(marks, random))
        parameters = _FALSE_PARAMETERS[int(random.integers(len(_FALSE_PARAMETERS)))]
        for what in ("@replay", "@head"):
            session.get(f"{stream}/{what}?{parameters}", zenoh.handlers.Callback(lambda _reply: None), timeout=0.5)
    return 3 * each


def _run_now(bus: Bus) -> str:
    """Return the run that plays now, else one that nobody announced."""
    try:
        state = bus.query(bus.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState, silence_seconds=1.0)
    except FaultError:
        return _NOBODY
    return state.run or _NOBODY


def _odd_encoding(sound: Message, random: np.random.Generator) -> str:
    if random.random() < 0.9:
        return encoding_of(sound)
    return str(random.choice(["", "text/plain", "application/protobuf;duralab.v1.Nothing", "application/protobuf"]))


def _odd_position(random: np.random.Generator) -> bytes | None:
    """Return an epoch and a number that no publisher has, or no such thing."""
    odd = int(random.integers(7))
    epoch = int(random.integers(1, 1000))
    match odd:
        case 0:
            return None
        case 1:
            return random.bytes(int(random.integers(0, 40)))
        case 2:
            return _POSITION.pack(epoch, _LARGEST)
        case 3:
            return _POSITION.pack(_LARGEST, int(random.integers(0, 5)))
        case 4:
            return _POSITION.pack(0, int(random.integers(0, 2**62)))
        case _:
            return _POSITION.pack(epoch, int(random.integers(0, 5)))
