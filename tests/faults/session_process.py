"""The hub of a lab as a process of its own, so that it can be killed: `session_process.py MODE ENDPOINT`.

Prints `ready` and runs until its standard input ends.
"""

from __future__ import annotations

import sys

from duralab_bus import BusConfig, BusMode, open_bus


def main() -> None:
    mode, endpoint = sys.argv[1:]
    with open_bus(BusConfig(mode=BusMode(mode), listen=(endpoint,)), service="hub"):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
