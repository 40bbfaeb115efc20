"""Servo-hydraulics in one picture, and the closed loops of the shipped rigs in one table, for docs/rigs/hydraulics.md.

`python studies/actuator_tuning.py` writes both again. The picture is of single actuators on a bench; the table comes
from the rigs' linearisation at rest.
"""

from __future__ import annotations

import dataclasses
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib as mpl
import numpy as np
import yaml
from marked_numbers import write_numbers
from rig_data_sheet import linearise

from rig_sim import Rig, load_rig, load_specimen, shipped_specimens
from rig_sim.hydraulics import (
    Accumulator,
    HydraulicActuator,
    HydraulicSupply,
    PowerUnit,
    Servovalve,
    Supply,
    port_flows,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts" / "specimens"))
from actuator_bench import Bench

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullFormatter

DOCS = Path(__file__).resolve().parents[1] / "docs" / "rigs"
RIGS = ("front_axle", "front_axle_compliant", "macpherson", "spindle_coupled", "spindle_coupled_braking")
#: The rig with all force actuators, as delivered with other oil and a wrong compensation.
TOLERANT = "spindle_coupled_braking"
DELIVERED = ((1.0, 1.0), (0.8, 1.0), (1.2, 1.0), (1.0, 1.1), (1.0, 0.95), (1.0, 0.9))
CONSTANT = Supply(2.8e7, 5.0e5)
#: 60 L/min behind 1.5 L of nitrogen: enough on average, not for a burst.
SAGGING = dataclasses.replace(
    CONSTANT,
    unit=PowerUnit(
        pump_flow=1.0e-3,
        compensator_band=1.0e6,
        pump_time=0.08,
        drain=1.0e-12,
        relief_pressure=3.1e7,
        relief_slope=1.0e-9,
        accumulator=Accumulator(gas_volume=1.5e-3, precharge=1.8e7, polytropic_exponent=1.25),
        line_volume=4.0e-3,
        bulk_modulus=1.2e9,
    ),
)


def bandwidth(rig: Rig, actuator: HydraulicActuator) -> tuple[float, float, float]:
    """Return the lowest frequency [Hz] with less than -3 dB, else the highest looked at; the largest gain and where."""
    frequency = np.arange(0.5, 200.0, 0.25)
    drive = rig.model.input_names.index(actuator.name)
    gain = np.abs(linearise(rig).response(actuator.achieved, drive, frequency))
    below = np.nonzero(gain < np.sqrt(0.5))[0]
    edge = float(frequency[below[0]]) if below.size else float(frequency[-1])
    return edge, float(gain.max()), float(frequency[gain.argmax()])


def least_damped(rig: Rig) -> tuple[float, float]:
    """Return frequency [Hz] and damping ratio of the mode that is damped least."""
    values = np.linalg.eigvals(linearise(rig).a)
    values = values[values.imag > 1.0]
    worst = values[np.argmin(-values.real / np.abs(values))]
    return float(np.abs(worst) / (2.0 * np.pi)), float(-worst.real / np.abs(worst))


def table(rigs: dict[str, Rig]) -> str:
    """Write the closed loops of the rigs, one side of each."""
    lines = ["| rig | drive | control | -3 dB at | largest gain |", "| --- | --- | --- | --- | --- |"]
    for name, rig in rigs.items():
        for element in rig.model.assembly.elements:
            if not isinstance(element, HydraulicActuator) or "right" in element.name:
                continue
            control = "displacement" if element.inputs[0].unit == "m" else "force"
            edge, gain, where = bandwidth(rig, element)
            follows = "compliant" if edge < 1.0 else f"{edge:.0f} Hz" if edge < 199.0 else "beyond 200 Hz"
            lines.append(f"| {name} | {element.name} | {control} | {follows} | {gain:.2f} at {where:.0f} Hz |")
    lines.append("")
    for name, rig in rigs.items():
        frequency, damping = least_damped(rig)
        lines.append(f"Least damped mode of {name}: {damping:.3f} at {frequency:.1f} Hz.")
    return "\n".join(lines)


def delivered(*, oil: float, compensation: float) -> Rig:
    """Return the rig TOLERANT with its bulk modulus and its motion compensation times these factors."""
    specimen = load_specimen(shipped_specimens()[TOLERANT])
    document = specimen.model_dump(mode="json")
    for kind in document["actuator_kinds"].values():
        kind["cylinder"]["bulk_modulus"] *= oil
        if kind["control"] == "force":
            for name in ("velocity_compensation", "acceleration_compensation"):
                kind["loop"][name] *= compensation
    with TemporaryDirectory() as folder:
        path = Path(folder) / "delivered.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        shutil.copy(shipped_specimens()[TOLERANT].with_name(specimen.sdf), folder)
        return load_rig(path)


def tolerance_table() -> str:
    """Write what is left of the force loops with other oil and a wrong compensation."""
    names = ("left_lateral", "left_longitudinal", "left_brake")
    head = [f"{name.removeprefix('left_')}: lowest, largest gain to 25 Hz" for name in names]
    lines = ["| bulk modulus | compensation | least damping | " + " | ".join(head) + " |", "| --- " * 6 + "|"]
    frequency = np.arange(0.5, 25.1, 0.25)
    for oil, compensation in DELIVERED:
        rig = delivered(oil=oil, compensation=compensation)
        linear = linearise(rig)
        gains = [
            np.abs(linear.response(f"{name}.force", rig.model.input_names.index(name), frequency)) for name in names
        ]
        cells = [f"{gain.min():.2f}, {gain.max():.2f}" for gain in gains]
        lines.append(
            f"| {100 * oil:.0f} % | {100 * compensation:.0f} % | {least_damped(rig)[1]:.3f} | "
            + " | ".join(cells)
            + " |"
        )
    return "\n".join(lines)


def draw_flow(axes: Axes) -> None:
    """Draw the no-load flow of three lappings over the spool's travel."""
    travel = np.linspace(-0.2, 0.2, 801)
    middle = 0.5 * (CONSTANT.supply_pressure + CONSTANT.return_pressure)
    for overlap, name in ((0.04, "overlap 4 %"), (0.0, "line to line"), (-0.04, "underlap 4 %")):
        valve = Servovalve(2.667e-3, 3.5e6, 110.0, 0.8, overlap=overlap, rounding=0.004)
        flows = [port_flows(valve, x, (middle, middle), CONSTANT.supply_pressure, 5.0e5) for x in travel]
        axes.plot(100 * travel, [6.0e4 * flow.into_a for flow in flows], label=f"to A, {name}")
        if overlap < 0.0:
            axes.plot(100 * travel, [6.0e4 * flow.drawn for flow in flows], "k:", label="from the supply, underlap")
    axes.set(title="Flow over spool travel, no load", xlabel="travel, % of stroke", ylabel="flow, L/min")


def draw_flow_pressure(axes: Axes) -> None:
    """Draw steady flow over load pressure, for several openings."""
    valve = Servovalve(2.667e-3, 3.5e6, 110.0, 0.8)
    loads = np.linspace(-1.1, 1.1, 401)
    span = CONSTANT.supply_pressure - CONSTANT.return_pressure
    for opening in (1.0, 0.5, 0.25, -0.5, -1.0):
        flows = []
        for load in loads:
            chambers = (0.5 * (2.85e7 + load * span), 0.5 * (2.85e7 - load * span))
            flows.append(6.0e4 * port_flows(valve, opening, chambers, CONSTANT.supply_pressure, 5.0e5).into_a)
        axes.plot(100 * loads, flows, label=f"opening {100 * opening:g} %")
    axes.set(title="Steady flow over load pressure", xlabel="load pressure, % of supply", ylabel="flow to A, L/min")


def on_bench(rig: Rig, supply: Supply) -> Bench:
    """Put the vertical actuator of a rig under a quarter of a car: wheel and suspension as one mass on a spring."""
    actuator = next(item for item in rig.model.assembly.elements if item.name == "left_vertical")
    if not isinstance(actuator, HydraulicActuator):
        raise TypeError(f"{actuator.name} of {rig.specimen.name} is no actuator.")
    alone = dataclasses.replace(actuator, joint_position=0, joint_velocity=0)
    return Bench(alone, HydraulicSupply(actuator.supply, supply), mass=60.0, stiffness=6.0e4, damping=2.5e3)


def draw_step(axes: Axes, bench: Bench) -> None:
    """Draw steps of the vertical actuator, small and large, over their height."""
    for height in (0.002, 0.02, 0.06):
        time, states = bench.play(lambda t, h=height: h if t > 0.005 else 0.0, 0.12, points=601)
        axes.plot(1e3 * time, states[0] / height, label=f"{1e3 * height:g} mm")
    axes.step([0.0, 5.0, 120.0], [0.0, 1.0, 1.0], "k:", where="post", label="command")
    axes.set(title="Step of the vertical actuator", xlabel="time, ms", ylabel="stroke / height of the step")


def amplitude(time: np.ndarray, values: np.ndarray, frequency: float) -> float:
    """Return the amplitude of one frequency in the second half of a record (samples,)."""
    half = len(time) // 2
    wave = np.exp(-2j * np.pi * frequency * time[half:])
    return float(2.0 * np.abs(np.mean(values[half:] * wave)))


def draw_sweep(axes: Axes, bench: Bench) -> None:
    """Draw achieved over wanted amplitude for small and large sines: a valve's flow sets the end of the large ones."""
    for height in (0.0005, 0.005, 0.02):
        gains = []
        frequencies = np.array([2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 70.0, 100.0])
        for f in frequencies:
            seconds = 8.0 / f
            time, states = bench.play(lambda t, h=height, f=f: h * np.sin(2 * np.pi * f * t), seconds, points=1601)
            gains.append(amplitude(time[:-1], states[0][:-1], f) / height)
        axes.loglog(frequencies, gains, "o-", markersize=3, label=f"{1e3 * height:g} mm")
    axes.set(title="Sweep of the vertical actuator", xlabel="frequency, Hz", ylabel="achieved / wanted amplitude")
    put_ticks(axes, frequency=(2, 5, 10, 20, 50, 100))


def put_ticks(axes: Axes, *, frequency: Sequence[float]) -> None:
    """Give both logarithmic axes numbers that are read at a glance, and draw the line of -3 dB."""
    axes.axhline(np.sqrt(0.5), color="grey", linestyle=":", label="-3 dB")
    axes.set_ylim(0.1, 2.0)
    for axis, ticks in ((axes.xaxis, frequency), (axes.yaxis, (0.1, 0.2, 0.5, 1, 2))):
        axis.set_major_locator(FixedLocator(ticks))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def draw_force(axes: Axes, rig: Rig) -> None:
    """Draw the FRF of the force loops of a rig, all on its left, from the linearisation at rest."""
    frequency = np.geomspace(0.5, 150.0, 600)
    linear = linearise(rig)
    for direction in ("lateral", "longitudinal", "brake"):
        name = f"left_{direction}"
        gain = np.abs(linear.response(f"{name}.force", rig.model.input_names.index(name), frequency))
        axes.loglog(frequency, gain, label=direction)
    axes.set(title=f"Force loops of {rig.specimen.name}", xlabel="frequency, Hz", ylabel="achieved / wanted force")
    put_ticks(axes, frequency=(0.5, 1, 2, 5, 10, 20, 50, 100))


def draw_sag(axes: Axes, rig: Rig) -> None:
    """Draw a supply that sags while a burst is played, and one that does not."""

    def burst(t: float) -> float:
        return 0.05 * float(np.sin(2.0 * np.pi * 4.0 * t)) if 0.25 < t < 1.25 else 0.0

    bench = on_bench(rig, SAGGING)
    time, states = bench.play(burst, 2.0, points=1001)
    pressure = bench.monitored(burst, time, states)["supply.pressure"]
    axes.plot([], [], color="#c0562a", label="supply pressure")
    axes.plot(time, 1e3 * states[0], color="#1b5e9b", label="stroke")
    axes.plot(time, [1e3 * burst(t) for t in time], "k:", label="command")
    axes.set(title="A burst, a small accumulator", xlabel="time, s", ylabel="stroke, mm", ylim=(-160, 80))
    right = axes.twinx()
    right.plot(time, 1e-5 * pressure, color="#c0562a")
    right.set(ylabel="supply pressure, bar", ylim=(0, 480), yticks=(0, 60, 120, 180, 240, 300))


def main() -> None:
    """Draw the picture and write the table."""
    rigs = {name: load_rig(shipped_specimens()[name]) for name in RIGS}
    stiff = on_bench(rigs["front_axle"], CONSTANT)
    figure, all_axes = plt.subplots(2, 3, figsize=(15.0, 8.5), layout="constrained")
    drawings: list[Callable[[Axes], Any]] = [
        draw_flow,
        draw_flow_pressure,
        lambda axes: draw_step(axes, stiff),
        lambda axes: draw_sweep(axes, stiff),
        lambda axes: draw_force(axes, rigs[TOLERANT]),
        lambda axes: draw_sag(axes, rigs["front_axle"]),
    ]
    for axes, draw in zip(all_axes.flat, drawings, strict=True):
        draw(axes)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(DOCS / "hydraulics.png", dpi=100, metadata={"Software": None})
    plt.close(figure)
    write_numbers(DOCS / "hydraulics.md", f"{table(rigs)}\n\n{tolerance_table()}", script=Path(__file__))


if __name__ == "__main__":
    main()
