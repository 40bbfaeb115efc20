"""Reproduce braking and cornering at 0.5 g over a rough road down to 0 Hz: means, slow forces and vibration together.

The predecessor drives over the road of `manoeuvre.yaml`; the manoeuvre's wheel forces are added to its responses.
python examples/reproduce_a_manoeuvre.py [ENDPOINT]
"""

import sys
from pathlib import Path

import numpy as np

import duralab
from duralab.formats import write_signals
from duralab.target import make_target

GRAVITIES, HEIGHT, WHEELBASE, TRACK = 0.5, 0.55, 2.8, 1.51  # lengths of the car in metres
campaign = duralab.load_campaign(Path(__file__).with_name("manoeuvre.yaml"))


def slow(record: np.ndarray) -> np.ndarray:
    """Return the part below 0.8 Hz of a record that begins and ends at rest."""
    kept = np.fft.rfftfreq(record.shape[1], 1.0 / rig.sample_rate) < 0.8
    return np.fft.irfft(np.fft.rfft(record) * kept, record.shape[1])


with duralab.connect(*sys.argv[1:2]) as lab:
    car, rig = lab.describe("predecessor"), lab.describe(campaign.rig)
    ride = make_target(campaign, rig=rig, vehicle=car, play=lambda road: lab.play(car.name, road).response).signals
    braking = GRAVITIES * np.interp(ride.time, [6, 7, 11, 12], [0, 1, 1, 0])
    turning = GRAVITIES * np.interp(ride.time, [15, 16, 21, 22, 23, 24, 29, 30], [0, 1, 1, 0, 0, -1, -1, 0])
    forces = ride.samples.copy()
    for first, to_the_left in ((0, 1.0), (3, -1.0)):  # vertical, lateral and longitudinal of a wheel
        load = car.static_response[first]
        moved = 2.0 * load * HEIGHT * (braking / WHEELBASE - to_the_left * turning / TRACK)
        forces[first : first + 3] += [moved, turning * (load + moved), -braking * (load + moved)]
    (file := Path("out/manoeuvre.parquet").resolve()).parent.mkdir(exist_ok=True)
    write_signals(duralab.Signals(ride.channels, ride.sample_rate, forces), file, overwrite=True)
    campaign = campaign.model_copy(update={"target": type(campaign.target)(file=file)})
    result = lab.run(campaign, out="out/manoeuvre", on_progress=print, timeout_seconds=600.0)

wanted = result.recording.target.samples
for number in (1, result.status.best_iteration):
    error = wanted - result.recording.playback(number).response_in_band.samples
    shares = [np.linalg.norm(part(error)) / np.linalg.norm(part(wanted)) for part in (slow, np.asarray)]
    print(f"playback {number}: error below 0.8 Hz {shares[0]:.3f}, in the whole band {shares[1]:.3f}")
