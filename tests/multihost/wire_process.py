"""A cable between two hosts, as a process: `wire_process.py NAMESPACE INTERFACE NAMESPACE INTERFACE SEED`.

Makes a network interface at each end and passes frames from one to the other. Each line on its standard input is a JSON
object that changes it: `delay` in s, `loss` as a share, `rate` in bytes a second (0 is without bound), `cut`. Prints
`ready`; ends with its input. The kernel's own emulation (netem) is not built into every kernel; this needs only TAP.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from pathlib import Path

MTU = 9000
_QUEUED_SECONDS = 0.25
"""How long a frame may wait for its turn before it is dropped, as in the queue of a switch."""

_CLONE_NEWNET = 0x40000000
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000


class Wire:
    """What a cable does to frames.

    Parameters
    ----------
    seed : int
        Decides which frames are lost.
    """

    def __init__(self, seed: int) -> None:
        self.delay = 0.0
        self.loss = 0.0
        self.rate = 0.0
        self.cut = False
        self._random = random.Random(seed)
        self._free = [0.0, 0.0]
        self._number = 0
        self.queue: list[tuple[float, int, int, bytes]] = []

    def take(self, frame: bytes, towards: int, now: float) -> None:
        """Take a frame at one end; it comes out at the other later, or never."""
        if self.cut or (self.loss and self._random.random() < self.loss):
            return
        begin = max(now, self._free[towards])
        if begin - now > _QUEUED_SECONDS:
            return
        self._free[towards] = begin + (len(frame) / self.rate if self.rate else 0.0)
        self._number += 1
        heapq.heappush(self.queue, (self._free[towards] + self.delay, self._number, towards, frame))

    def due(self, now: float) -> list[tuple[int, bytes]]:
        """Return the frames that come out by now, with their end."""
        found = []
        while self.queue and self.queue[0][0] <= now:
            _, _, towards, frame = heapq.heappop(self.queue)
            if not self.cut:
                found.append((towards, frame))
        return found


def make_interface(namespace: str, name: str) -> int:
    """Make an interface in a network namespace and return what its frames are read from."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path("/run/netns", namespace).open() as handle:
        if libc.setns(handle.fileno(), _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {namespace}")
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(end, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TAP | _IFF_NO_PI))
    subprocess.run(["ip", "link", "set", name, "mtu", str(MTU), "up"], check=True)
    return end


def main() -> None:
    *places, seed = sys.argv[1:]
    ends = [make_interface(*places[:2]), make_interface(*places[2:])]
    wire = Wire(int(seed))
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    commands, text = sys.stdin.fileno(), b""
    while True:
        wait = max(0.0, wire.queue[0][0] - time.monotonic()) if wire.queue else None
        readable, _, _ = select.select([*ends, commands], [], [], wait)
        if commands in readable:
            read = os.read(commands, 4096)
            if not read:
                return
            *lines, text = (text + read).split(b"\n")
            for line in lines:
                vars(wire).update(json.loads(line))
        for index, end in enumerate(ends):
            if end in readable:
                _read_all(end, wire, towards=1 - index)
        for towards, frame in wire.due(time.monotonic()):
            try:
                os.write(ends[towards], frame)
            except OSError:
                # The interface is down, or its queue is full: lost, as on any cable.
                continue


def _read_all(end: int, wire: Wire, *, towards: int) -> None:
    for _ in range(64):
        try:
            frame = os.read(end, MTU + 64)
        except BlockingIOError:
            return
        wire.take(frame, towards, time.monotonic())


if __name__ == "__main__":
    main()
