"""Effect of each kind of wear on the responses of the front axle, for docs/rigs/wear.md.

`python studies/rig_wear.py` plays one minute of rough road on `front_axle_wearing`, as new and with one loss at a time,
and writes table and picture again. The sensors' noise is the same in all playbacks but the second.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from marked_numbers import write_numbers
from rig_cell import responses_of
from scipy.signal import welch

from rig_sim import Lost, Rig, WearState, load_rig, shipped_specimens

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parents[1] / "docs" / "rigs"
SECONDS = 60
#: RMS in m, and the power of frequency with which a stroke falls from 0.7 Hz on.
STROKES = ((0.008, 1.5), (0.0003, 1.0), (0.0015, 1.2))
LOSSES = {
    "left bushing: 10 % of stiffness and damping": {"left_lower_rear_bushing": Lost(stiffness=0.1, damping=0.1)},
    "left bushing at the end of its life: 30 %": {"left_lower_rear_bushing": Lost(stiffness=0.3, damping=0.3)},
    "left tie rod cracked: 80 %": {"left_tie_rod": Lost(stiffness=0.8, damping=0.8)},
    "left damper at the end of its life: 60 %": {"left_strut_damper": Lost(damping=0.6)},
}


def rough_road(rig: Rig, *, seconds: float = SECONDS, seed: int = 5) -> np.ndarray:
    """Return strokes (6, samples) in m with random phases from 0.7 to 25 Hz, faded over a second."""
    rate, rng = rig.specimen.sample_rate, np.random.default_rng(seed)
    samples = round(seconds * rate)
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    band = (frequency >= 0.7) & (frequency <= 25.0)
    ends = np.minimum(np.arange(samples), np.arange(samples)[::-1]) / rate
    rows = []
    for rms, power in 2 * STROKES:
        spectrum = np.zeros(len(frequency), dtype=complex)
        phases = rng.uniform(0.0, 2.0 * np.pi, np.count_nonzero(band))
        spectrum[band] = frequency[band] ** -power * np.exp(1j * phases)
        row = np.fft.irfft(spectrum, samples)
        rows.append(rms * row / np.std(row) * np.minimum(ends, 1.0))
    return np.array(rows)


def main() -> None:
    """Write table and picture again."""
    rig = load_rig(shipped_specimens()["front_axle_wearing"])
    drive, names = rough_road(rig), rig.model.response_names
    first = rig.playback(drive, seed=1)
    worn_ones = [rig.playback(drive, seed=1, condition=rig.changed(lost)) for lost in LOSSES.values()]
    other_noise = rig.playback(drive, seed=2)
    other_gain = rig.playback(drive, seed=1, condition=rig.changed(gains={"left_vertical": 0.02}))
    as_new, noisy, drifted, *responses = responses_of([first, other_noise, other_gain, *worn_ones])
    scale = np.std(as_new, axis=1)
    worn = dict(zip(LOSSES, responses, strict=True))
    rows = {"nothing, other noise": noisy, **worn, "gain of left_vertical: 2 %": drifted}
    lines = [
        f"| lost | {' | '.join(names)} |",
        f"| --- |{' --- |' * len(names)}",
        *(
            f"| {what} | {' | '.join(f'{share:.1f}' for share in 100.0 * np.std(response - as_new, axis=1) / scale)} |"
            for what, response in rows.items()
        ),
        "",
        "| part | damage of this minute | repeats of it to damage 1 |",
        "| --- | --- | --- |",
        *(
            f"| {part} | {damage:.2g} | {1.0 / damage:.0f} |"
            for part, damage in rig.worn(WearState(), first).damage.items()
        ),
    ]
    write_numbers(DOCS / "wear.md", "\n".join(lines), script=Path(__file__))
    figure, axes = plt.subplots(len(worn), 3, figsize=(10.0, 2.1 * len(worn)), sharex=True, layout="constrained")
    for line, (what, response) in zip(axes, worn.items(), strict=True):
        for row, place in enumerate(line):
            shown = (
                ("as new", as_new[row], "0.3"),
                ("worn", response[row], "C1"),
                ("difference", response[row] - as_new[row], "C2"),
            )
            for label, values, colour in shown:
                frequency, power = welch(values - values.mean(), rig.specimen.sample_rate, nperseg=4096)
                place.semilogy(frequency, np.sqrt(power), color=colour, linewidth=0.9, label=label)
            place.set_xlim(0.0, 60.0)
            place.set_ylim(0.1, 1.0e4)
            place.set_title(f"{what.partition(':')[0]}: {names[row]}", fontsize=7)
            place.tick_params(labelsize=7)
        line[0].set_ylabel("N/√Hz", fontsize=7)
    axes[0][0].legend(fontsize=7)
    for place in axes[-1]:
        place.set_xlabel("frequency, Hz", fontsize=7)
    figure.savefig(DOCS / "wear.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
