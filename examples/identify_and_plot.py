"""Identify a rig and plot its frequency response; the page opens in any browser, offline.

python examples/identify_and_plot.py [ENDPOINT]
"""

import sys
from pathlib import Path

import duralab

RIG = "front_axle_compliant"
out = Path("out")
out.mkdir(exist_ok=True)

excitation = duralab.ExcitationSettings(
    lowest_frequency=0.4,
    highest_frequency=45.0,
    corner_frequency=2.0,
    decibels_per_octave=3.0,
    rms=0.002,
    duration=75.0,
    fade=1.0,
)
estimator = duralab.EstimatorSettings(block_samples=2048)

with duralab.connect(*sys.argv[1:2]) as lab:
    print(lab.identifier.plan(RIG, excitation, estimator))
    model = lab.identify(RIG, excitation, estimator, seed=1, on_progress=print, timeout_seconds=300.0)
    print(model)
    (out / "frf.html").write_text(duralab.to_html(model), encoding="utf-8")

# The model as labelled arrays: the largest vertical force per metre of the drive on the same side.
frf = model.to_xarray().frf.sel(response="left_vertical", drive="left_vertical", frequency=slice(0.5, 40.0))
peak = abs(frf).idxmax("frequency")
print(f"largest at {float(peak):.1f} Hz: {float(abs(frf).max()):.3g} N/m")
