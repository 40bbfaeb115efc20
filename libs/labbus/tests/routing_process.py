"""A router as a process of its own, so that a test can freeze and kill it: where it listens is its argument."""

import sys

import labbus

with labbus.open_bus(labbus.BusConfig(mode="router", listen=(sys.argv[1],)), service="router") as bus:
    sys.stdout.write(f"{bus.listening[0]}\n")
    sys.stdout.flush()
    sys.stdin.read()
