"""Comes to the bus and does not end when told to."""

import signal
import sys
import time
from pathlib import Path

import yaml

from duralab_bus import BusConfig, open_bus

settings = yaml.safe_load(Path(sys.argv[2]).read_text())
with open_bus(BusConfig.model_validate(settings["bus"]), service="stubborn") as bus:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    bus.declare_live("stubborn", "main")
    time.sleep(600)
