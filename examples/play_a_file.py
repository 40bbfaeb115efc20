"""Play a drive from an RPC III file and write the response into another: read, map, play, convert.

python examples/play_a_file.py [ENDPOINT]
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import duralab
from duralab.formats import convert_units, read_signals, write_signals

out = Path("out")
out.mkdir(exist_ok=True)

with duralab.connect(*sys.argv[1:2]) as lab:
    rig = lab.describe("front_axle_compliant")

    # A file from another lab: in millimetres, with the channels in another order.
    time = np.arange(4096) / rig.sample_rate
    heave = 5.0 * np.sin(2 * np.pi * 2.0 * time) * np.sin(np.pi * time / time[-1]) ** 2
    channels = tuple(replace(channel, unit="mm", minimum=-np.inf, maximum=np.inf) for channel in reversed(rig.drives))
    sent = duralab.Signals(channels, rig.sample_rate, np.tile(heave, (len(channels), 1)))
    write_signals(sent, out / "heave.drv", overwrite=True)

    drive = read_signals(out / "heave.drv")
    in_metres = convert_units(drive, dict.fromkeys(drive.names, "m"))
    played = lab.play(rig.name, in_metres)
    print(played)
    print(write_signals(played.response, out / "heave.rsp", overwrite=True))
