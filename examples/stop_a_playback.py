"""Stop a playback: by a time limit, by another thread, or by any client; then inspect the rig and reset it.

python examples/stop_a_playback.py [ENDPOINT]
"""

import sys
import threading

import numpy as np

import duralab

with duralab.connect(*sys.argv[1:2]) as lab:
    rig = lab.describe("front_axle_compliant")
    time = np.arange(int(60 * rig.sample_rate)) / rig.sample_rate
    drive = 0.005 * np.sin(2 * np.pi * time) * np.minimum(1.0, np.minimum(time, time[-1] - time))
    drives = np.tile(drive, (len(rig.drives), 1))

    # A drive of one minute in real time, with a limit of half a second.
    try:
        lab.play(rig.name, drives, real_time=True, timeout_seconds=0.5)
    except duralab.LabTimeoutError as error:
        print(error)
    print(lab.state(rig.name))
    lab.reset(rig.name)

    # The same drive, stopped by an operator at the rig.
    threading.Timer(0.5, lab.stop_rig, args=(rig.name,), kwargs={"reason": "the strut looks hot"}).start()
    try:
        lab.play(rig.name, drives, real_time=True)
    except duralab.StoppedError as error:
        print(error)
    print(lab.state(rig.name))
    print(lab.reset(rig.name))
