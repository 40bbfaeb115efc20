"""Read the recording of a campaign with xarray: numbers, a window of the signals, the spectrum of the error.

python examples/read_a_recording.py [ENDPOINT | RECORDING.mcap]
"""

import sys
from pathlib import Path

import numpy as np

import duralab

given = sys.argv[1:2]
if given and given[0].endswith(".mcap"):
    recording = duralab.open(given[0])
else:
    with duralab.connect(*given) as lab:
        recording = lab.run(Path(__file__).with_name("short_campaign.yaml"), out="out/recorded").recording

print(recording)
figures = recording.iterations.to_xarray()
print(figures.relative_rms_error.sel(channel="left_vertical").values.round(3))

responses = recording.responses()  # lazy: samples are read at their first use
window = responses.sel(time=slice(3.0, 5.0)).load()
print(window.left_vertical.max("time").values.round())

error = recording.error().isel(run=-1)  # target minus response, both in the control band
spectrum = np.abs(np.fft.rfft(error.left_vertical.values))
worst = np.fft.rfftfreq(error.sizes["time"], 1.0 / error.attrs["sample_rate"])[spectrum.argmax()]
print(f"most of the error of left_vertical is at {worst:.1f} Hz")
