"""A router as a process of its own, from a zenohd configuration: `router_process.py FILE OVERRIDES`.

OVERRIDES is a JSON object of Zenoh's keys and values, as `zenohd --cfg` takes them. Prints `ready` and runs until its
standard input ends. Zenoh's log goes to standard error, as far as RUST_LOG says.
"""

from __future__ import annotations

import json
import sys

import zenoh


def main() -> None:
    file, overrides = sys.argv[1:]
    zenoh.init_log_from_env_or("warn")
    config = zenoh.Config.from_file(file)
    for key, value in json.loads(overrides).items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
