"""A short playback as an operator: `operator_script.py CERTIFICATES RIG`; prints what came of it as JSON."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

import duralab


def main() -> None:
    certificates, name = Path(sys.argv[1]), sys.argv[2]
    with duralab.connect("tls/router:7447", identity=certificates / "operator.main") as lab:
        rig = lab.describe(name)
        drive = np.zeros((len(rig.drives), round(0.5 * rig.sample_rate)))
        drive[0] = 1e-3 * np.sin(2 * np.pi * 4.0 * np.arange(drive.shape[1]) / rig.sample_rate)
        lab.play(name, drive)
        health = {(each.service, each.instance): each for each in lab.health()}
    playing, recording = health["rig_sim", name], health["recorder", "main"]
    written = {
        "live": sorted(f"{service}/{instance}" for service, instance in health),
        "troubles": [each.trouble for each in health.values() if each.trouble],
        "playbacks": playing.value("duralab_rig_playbacks_total", rig=name, code="OK"),
        "received": recording.value("duralab_stream_received_messages_total", message="SignalBlock"),
    }
    sys.stdout.write(json.dumps(written))


if __name__ == "__main__":
    main()
