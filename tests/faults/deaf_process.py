"""A subscriber to everything that never reads: `deaf_process.py ENDPOINT`.

Zenoh's own default handler holds 256 messages and then stalls the session's receiving thread, and the link with it:
what an engineer's script does to a lab when it stands at a breakpoint. Prints `ready`, runs until its input ends.
"""

from __future__ import annotations

import os
import sys

import zenoh


def main() -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
    config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    subscriber = session.declare_subscriber("duralab/v1/**")
    sys.stdout.write(f"ready {subscriber.key_expr}\n")
    sys.stdout.flush()
    sys.stdin.read()
    # Closing would wait for the thread that is stalled.
    os._exit(0)


if __name__ == "__main__":
    main()
