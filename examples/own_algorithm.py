"""Iterate with a custom algorithm: two lines of numpy on the iterator's pure core, with a rig of the lab.

The core uses no bus: `rig_model` inverts, `ControlBand` filters, `judge_response` judges. Here the update is a plain
Time Waveform Replication with a gain that grows. python examples/own_algorithm.py [ENDPOINT]
"""

import sys
from pathlib import Path

import numpy as np

import duralab
from iterator import apply_inverse, control_band, judge_response, rig_model

settings = duralab.load_campaign(Path(__file__).with_name("short_campaign.yaml"))

with duralab.connect(*sys.argv[1:2]) as lab:
    rig = lab.describe("front_axle_compliant")
    model = lab.identify(rig.name, settings.excitation, settings.estimator, seed=1)
    inverse = rig_model(model.frequency, model.frf, identified_band=(0.25, 46.0))
    band = control_band(0.5, 40.0, sample_rate=rig.sample_rate)

    # A target that is reachable: the rig's response to a known drive.
    noise = np.random.default_rng(1).standard_normal((len(rig.drives), 8000))
    hidden = 0.004 * band.limit_response(noise * np.sin(np.pi * np.arange(8000) / 8000) ** 2)
    target = band.limit_target(lab.play(rig.name, hidden).response.samples)

    drive = np.zeros_like(hidden)
    response = np.zeros_like(target)
    for gain in (0.7, 0.8, 0.9):
        drive = drive + gain * apply_inverse(inverse, target - response, band=band)
        response = band.limit_response(lab.play(rig.name, drive).response.samples)
        print(f"gain {gain}: relative RMS error", judge_response(target, response).relative_rms_error.round(3))
