"""Pictures of the rigs aerospace and full_vehicle into docs/rigs, and the mode tables to set beside them.

`python studies/aerospace_and_full_vehicle.py` writes them; the tables go to standard output. Everything is computed
from the rigs that play, without noise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from rig_sim import load_rig, shipped_specimens
from rig_sim.structure import StructureRig, load_structure

mpl.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts" / "specimens"))
from full_vehicle import WHEELBASE
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parents[1] / "docs" / "rigs"
SPEED = 15.0


def draw_aerospace(rig: StructureRig) -> None:
    """Draw driving-point and transfer FRFs, the two close torsion modes, and the sampled FRF beside the structure's."""
    figure, (whole, close, sampled) = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    frequency = np.linspace(0.5, 90.0, 20_000)
    frf = rig.sampled_frf(frequency)
    for row, column, name in (
        (0, 0, "left wing"),
        (2, 2, "nose, lateral"),
        (3, 3, "tail"),
        (1, 0, "left to right wing"),
    ):
        whole.semilogy(frequency, np.abs(frf[:, row, column]), lw=0.8, label=name)
    near = np.linspace(29.0, 36.0, 4000)
    fine = rig.sampled_frf(near)
    for row, name in ((0, "left wing by left wing"), (1, "right wing by left wing")):
        close.semilogy(near, np.abs(fine[:, row, 0]), lw=0.9, label=name)
    ratio = np.abs(rig.sampled_frf(frequency)[:, 0, 0] / rig.modes.continuous_frf(frequency)[:, 0, 0])
    sampled.plot(frequency, ratio, lw=0.9, label="sampled over continuous")
    sampled.set_ylim(0.8, 1.05)
    for axes, title, upright in (
        (whole, "acceleration per force", "(m/s²)/N"),
        (close, "two torsion modes of the wing, 1.5 % apart", "(m/s²)/N"),
        (sampled, "left wing: what sampling does to it", "ratio"),
    ):
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("frequency, Hz", fontsize=8)
        axes.set_ylabel(upright, fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(visible=True, color="0.9")
        axes.legend(fontsize=7)
    figure.savefig(DOCS / "aerospace.png", dpi=110, metadata={"Software": None})
    plt.close(figure)
    for number, (f, damping) in enumerate(zip(rig.modes.frequency, rig.modes.damping, strict=True), start=1):
        sys.stdout.write(f"| {number} | {f:.2f} | {100 * damping:.1f} % |\n")


def draw_full_vehicle() -> None:
    """Draw the car over a bump of 20 mm in 1 m: forces of both axles, heave and pitch; and the ride FRF."""
    rig = load_rig(shipped_specimens()["full_vehicle"])
    names, rate = rig.model.input_names, rig.specimen.sample_rate
    time = np.arange(2000) / rate
    drive = np.zeros((len(names), len(time)))
    for index, name in enumerate(names):
        way = np.clip(SPEED * (time - 0.1) - (WHEELBASE if name.startswith("rear_") else 0.0), 0.0, 1.0)
        if name.endswith("speed"):
            drive[index] = SPEED
        elif name.endswith("height"):
            drive[index] = 0.01 * (1 - np.cos(2 * np.pi * way))
        elif name.endswith("slope"):
            drive[index] = 0.02 * np.pi * np.sin(2 * np.pi * way)
    ahead = np.hstack([drive, drive[:, -1:]])
    state, poses = rig.rest.copy(), []
    forces = []
    for begin in range(0, len(time), 10):
        played = rig.compiled.play(
            state,
            ahead[:, begin : begin + 11],
            sample_interval=1 / rate,
            substeps=rig.specimen.substeps,
            method=rig.specimen.integrator,
        )
        poses.append(state[[0, 1]] - rig.rest[[0, 1]])
        forces.append(played.outputs[:12])
        state = played.state
    force = np.hstack(forces) - rig.static_response[:, None]
    figure, (vertical, along, body) = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    for row, label in ((0, "front"), (6, "rear")):
        vertical.plot(time, force[row] / 1e3, lw=0.9, label=f"{label} left")
        along.plot(time, force[row + 2] / 1e3, lw=0.9, label=f"{label} left")
    coarse = time[::10]
    pose = np.array(poses)
    body.plot(coarse, 1e3 * pose[:, 0], label="heave, mm")
    body.plot(coarse, 1e1 * np.rad2deg(pose[:, 1]), label="pitch, 0.1°, nose down")
    for axes, title, upright in (
        (vertical, "vertical spindle force", "change, kN"),
        (along, "longitudinal spindle force", "change, kN"),
        (body, "body", ""),
    ):
        axes.set_title(f"{title}: bump of 20 mm in 1 m at 15 m/s", fontsize=8)
        axes.set_xlabel("time, s", fontsize=8)
        axes.set_ylabel(upright, fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(visible=True, color="0.9")
        axes.legend(fontsize=7)
    figure.savefig(DOCS / "full_vehicle.png", dpi=110, metadata={"Software": None})
    plt.close(figure)
    step = 1e-6 * np.eye(len(rig.rest))
    about = np.array([SPEED if name.endswith("speed") else 0.0 for name in names])
    columns = [
        (rig.compiled.derivative(rig.rest + e, about) - rig.compiled.derivative(rig.rest - e, about)) / 2e-6
        for e in step
    ]
    for value in sorted(np.linalg.eigvals(np.array(columns).T), key=abs):
        if value.imag > 1e-3 and 0.1 < abs(value) / (2 * np.pi) < 60.0:
            sys.stdout.write(f"| {abs(value) / (2 * np.pi):.1f} | {-value.real / abs(value):.2f} |\n")
    sys.stdout.write(f"{rig.static_response.round()}\n{rig.proof}\n{len(rig.rest)} {rig.compiled.operation_count}\n")


if __name__ == "__main__":
    draw_aerospace(load_structure(shipped_specimens()["aerospace"]))
    draw_full_vehicle()
