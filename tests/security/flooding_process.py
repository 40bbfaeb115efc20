"""Somebody who asks without end: `flooding_process.py ENDPOINT FOLDER NAME KEY ENCODING`.

Shows the certificate NAME of FOLDER, or none where it is "-": then it only opens links. Prints `ready`, floods until
its standard input ends, and prints how often it asked.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
from pathlib import Path

import zenoh


def main() -> None:
    endpoint, folder, name, key, encoding = sys.argv[1:]
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    asked = 0
    if name == "-":
        host, _, port = endpoint.removeprefix("tls/").rpartition(":")
        _say("ready")
        while not ended.is_set():
            with contextlib.suppress(OSError), socket.create_connection((host, int(port)), timeout=1.0) as link:
                link.sendall(b"\x16\x03\x01\x02\x00\x01" + bytes(506))
                asked += 1
        _say(str(asked))
        return
    from .access_trials import secured_config

    with zenoh.open(secured_config(endpoint, Path(folder), name)) as session:
        session.get(key, encoding=encoding, timeout=5.0)
        _say("ready")
        while not ended.is_set():
            session.get(
                key, zenoh.handlers.Callback(lambda _reply: None, indirect=False), encoding=encoding, timeout=1.0
            )
            asked += 1
        _say(str(asked))


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
