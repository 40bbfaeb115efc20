"""A TCP connection that can be cut and healed: a proxy between a service and the router it talks through."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import suppress
from enum import StrEnum

_CHUNK = 1 << 16
# SO_LINGER with no time: closing sends a reset at once, as a switch does that loses its power.
_RESET = struct.pack("ii", 1, 0)


class Cut(StrEnum):
    """How a connection breaks."""

    RESET = "reset"
    """Both ends are told at once, and nobody answers until it is healed."""
    SILENT = "silent"
    """Nothing passes any more and nobody is told: a pulled cable. What was sent is passed on when it is healed."""


class CuttableLink:
    """Listens on a free port of 127.0.0.1 and passes everything on to another."""

    def __init__(self, target_port: int) -> None:
        self._target = target_port
        self._open = threading.Event()
        self._open.set()
        self._refusing = False
        self._closed = False
        self._lock = threading.Lock()
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name="link-accept", daemon=True).start()

    def cut(self, how: Cut) -> None:
        if how is Cut.SILENT:
            self._open.clear()
            return
        self._refusing = True
        self._drop_all()

    def heal(self) -> None:
        self._refusing = False
        self._open.set()

    def close(self) -> None:
        self._closed = True
        self._open.set()
        self._listener.close()
        self._drop_all()

    def _drop_all(self) -> None:
        with self._lock:
            pairs, self._pairs = self._pairs, []
        for pair in pairs:
            for end in pair:
                _reset(end)

    def _accept(self) -> None:
        while not self._closed:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if self._refusing:
                _reset(near)
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self._target), timeout=5.0)
            except OSError:
                _reset(near)
                continue
            far.settimeout(None)
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._pairs.append((near, far))
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pass_on, args=(source, sink), name="link", daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while True:
                self._open.wait()
                data = source.recv(_CHUNK)
                # Received while it was being cut: it is on the cable until it is healed.
                self._open.wait()
                if not data:
                    break
                sink.sendall(data)
        for end in (source, sink):
            _reset(end)
        with self._lock:
            self._pairs = [pair for pair in self._pairs if source not in pair]


def _reset(end: socket.socket) -> None:
    with suppress(OSError):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
        end.shutdown(socket.SHUT_RDWR)
    with suppress(OSError):
        end.close()
