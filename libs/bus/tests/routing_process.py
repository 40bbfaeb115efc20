"""A router as a process of its own, so that a test can freeze and kill it: where it listens is its argument.

With a second argument it says when it could start and waits for a line: then it is up within milliseconds.
"""

import sys

import duralab_bus

if sys.argv[2:]:
    sys.stdout.write("held\n")
    sys.stdout.flush()
    sys.stdin.readline()
with duralab_bus.open_bus(duralab_bus.BusConfig(mode="router", listen=(sys.argv[1],)), service="router") as bus:
    sys.stdout.write(f"{bus.listening[0]}\n")
    sys.stdout.flush()
    sys.stdin.read()
