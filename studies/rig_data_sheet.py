"""The data sheets of the shipped rigs: numbers into docs/rigs/<rig>.md, one picture of each beside them.

`python studies/rig_data_sheet.py [RIG…]` writes them again. Everything is computed from the rig that plays: its
linearisation at rest (rubber sticks there, so this is the rig of small amplitudes; on a road, at 15 m/s) and short
playbacks without noise.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from marked_numbers import write_numbers

from rig_sim import Rig, load_rig, shipped_specimens
from rig_sim.checks import largest_stable_step
from rig_sim.multibody import inertia_in_world, move

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parents[1] / "docs" / "rigs"
SIDE = ("vertical", "lateral", "longitudinal")
COLOURS = {"vertical": "#1b5e9b", "lateral": "#c0562a", "longitudinal": "#3d8b4f"}
HIGHEST_MODE = 60.0
SPEED = 15.0
#: Digits after the point that a value at rest deserves, by its unit.
DIGITS = {"N": 0, "N*m": 1, "m": 4, "m/s^2": 1}
Complex = np.ndarray[Any, np.dtype[np.complex128]]


@dataclass(frozen=True)
class Linearisation:
    """A rig at rest as x' = A x + B u, y = C x + D u; y are responses and monitored values by name."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    outputs: tuple[str, ...]

    def response(self, output: str, drive: int, frequency: np.ndarray) -> np.ndarray:
        """Return the FRF (lines,) from one drive to one output at frequencies [Hz]."""
        row = self.outputs.index(output)
        eye = np.eye(len(self.a))
        return np.array(
            [
                self.c[row] @ np.linalg.solve(2j * np.pi * f * eye - self.a, self.b[:, drive]) + self.d[row, drive]
                for f in frequency
            ]
        )


def cruise(rig: Rig) -> np.ndarray:
    """Return drives (drives,) that keep the rig at rest: zero, but on a road rolling at SPEED."""
    return np.array([SPEED if channel.unit == "m/s" else 0.0 for channel in rig.specimen.drives])


def linearise(rig: Rig) -> Linearisation:
    """Differentiate the rig about its rest, centrally; on a road at SPEED, where the rest is the same."""
    about = cruise(rig)
    step = 1.0e-6

    def both(state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        return np.concatenate([rig.compiled.derivative(state, inputs), rig.compiled.outputs(state, inputs)])

    steps = step * np.eye(len(rig.rest)), step * np.eye(len(about))
    x = np.array([both(rig.rest + e, about) - both(rig.rest - e, about) for e in steps[0]]).T / (2 * step)
    u = np.array([both(rig.rest, about + e) - both(rig.rest, about - e) for e in steps[1]]).T / (2 * step)
    n = len(rig.rest)
    return Linearisation(x[:n], u[:n], x[n:], u[n:], rig.compiled.output_names)


def what_moves(rig: Rig, speeds: Complex) -> str:
    """Say which body has most of the kinetic energy in a mode, and for a wheel, where it goes.

    Parameters
    ----------
    rig : Rig
        At rest.
    speeds : (n_v,) complex
        The velocities of the mode's shape.
    """
    tree = rig.model.assembly.tree
    n_q = rig.model.position_count
    energy: dict[str, float] = {}
    way = np.zeros(3)
    for part in (speeds.real, speeds.imag):
        motion = move(tree, rig.rest[:n_q], part)
        for body, pose, velocity in zip(tree.bodies, motion.poses, motion.velocities, strict=True):
            name = body.name.removeprefix("left_").removeprefix("right_")
            momentum = inertia_in_world(body, pose).momentum(velocity)
            energy[name] = energy.get(name, 0.0) + 0.5 * float(velocity.power(momentum))
            if name == "wheel":
                way += velocity.at(pose.origin) ** 2
    largest = max(energy, key=lambda name: energy[name])
    if largest in {"wheel", "knuckle"}:
        return f"wheel, {('longitudinal', 'lateral', 'vertical')[int(np.argmax(way))]}"
    return largest.replace("_", " ")


def modes(rig: Rig, system: Linearisation) -> list[tuple[float, float, str, int]]:
    """Return frequency [Hz], damping ratio, what moves and how often it is there, of the oscillating modes to 60 Hz."""
    values, vectors = cast(tuple[Complex, Complex], np.linalg.eig(system.a))
    n_q, n_v = rig.model.position_count, rig.model.assembly.tree.velocity_count
    found: list[tuple[float, float, str, int]] = []
    for index in np.argsort(np.abs(values)):
        value, speeds = values[index], vectors[n_q : n_q + n_v, index]
        frequency = float(abs(value) / (2 * np.pi))
        if value.imag < 1.0e-3 or not 0.1 < frequency <= HIGHEST_MODE:
            continue
        damping = float(-value.real / abs(value))
        moving = what_moves(rig, speeds / np.abs(speeds).max())
        # The sides swing with and against each other at all but one frequency.
        if found and found[-1][2] == moving and frequency < 1.01 * found[-1][0]:
            found[-1] = (*found[-1][:3], found[-1][3] + 1)
        else:
            found.append((frequency, damping, moving, 1))
    return found


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    lines = ["| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows]]
    return "\n".join(lines)


def data_sheet(rig: Rig, system: Linearisation) -> str:
    """Return the tables of a rig as Markdown."""
    drives = [
        [
            c.name,
            c.unit,
            f"{c.minimum:g} to {c.maximum:g}",
            f"{c.slew_limit:g} {c.unit}/s" if c.slew_limit else "none",
            f"{c.actuator_speed:g} {c.unit}/s" if c.actuator_speed else "not stated",
        ]
        for c in rig.specimen.drives
        if not c.name.startswith("right_")
    ]
    responses = [
        [c.name, c.unit, f"±{c.range:g}", f"{c.noise_rms:g}", f"{value:z.{DIGITS[c.unit]}f}"]
        for c, value in zip(rig.specimen.responses, rig.static_response, strict=True)
        if not c.name.startswith("right_")
    ]
    eigen = [[f"{f:.1f}", f"{damping:.2f}", moving, f"{count}"] for f, damping, moving, count in modes(rig, system)]
    speed = rig.specimen.sample_rate
    poles = np.linalg.eigvals(system.a).astype(complex)
    stiffest = np.abs(poles).max()
    return "\n\n".join(
        [
            table(["drive (left; right the same)", "unit", "limits", "slew limit", "actuator speed"], drives),
            table(["response (left; right mirrored)", "unit", "range", "noise, RMS", "at rest"], responses),
            table(["mode at rest, Hz", "damping ratio", "most of the motion", "modes"], eigen),
            f"Sample rate {speed:g} Hz, steps a sample: {rig.specimen.substeps} of {rig.specimen.integrator.value}; "
            f"the fastest eigenvalue\ntimes the step is {stiffest / speed / rig.specimen.substeps:.2f}, "
            f"the longest stable step {1e3 * largest_stable_step(poles, rig.specimen.integrator):.2f} ms. "
            f"{len(rig.rest)} states, {rig.compiled.operation_count} operations a derivative.\n"
            f"Largest error against Drake: {rig.proof.acceleration_error:.0e} of the accelerations, "
            f"{rig.proof.force_error:.0e} of the responses.",
        ]
    )


def play(rig: Rig, drive: np.ndarray) -> np.ndarray:
    """Return all outputs (outputs, samples) of a drive (drives, samples) that may step as no client's drive may."""
    ahead = np.hstack([drive, drive[:, -1:]])
    sample = 1.0 / rig.specimen.sample_rate
    specimen = rig.specimen
    return rig.compiled.play(
        rig.rest, ahead, sample_interval=sample, substeps=specimen.substeps, method=specimen.integrator
    ).outputs


def draw_static(axes: Axes, rig: Rig) -> None:
    """Draw spindle forces over the travel of both wheels, and of one alone, moved so slowly that dampers hardly act."""
    rate, period = rig.specimen.sample_rate, 40.0
    time = np.arange(round(1.25 * period * rate)) / rate
    travel = 0.09 * np.sin(2 * np.pi * time / period)
    names = rig.model.input_names
    loop = slice(round(0.25 * period * rate), None, 20)
    for moved, style in ((("left", "right"), "-"), (("left",), ":")):
        drive = np.zeros((len(names), len(time)))
        for side in moved:
            drive[names.index(f"{side}_vertical")] = travel
        outputs = play(rig, drive)
        stroke = outputs[rig.compiled.output_names.index("left_vertical.stroke")]
        force = outputs[rig.model.response_names.index("left_vertical")]
        text = "both wheels" if len(moved) == 2 else "left wheel alone"
        axes.plot(1000 * stroke[loop], force[loop] / 1e3, style, color=COLOURS["vertical"], lw=1.0, label=text)
    axes.plot(0.0, rig.static_response[0] / 1e3, "o", color="0.2", ms=4, label="at rest")
    label(axes, "static equilibrium: vertical force over wheel travel", "travel of the wheel, mm", "spindle force, kN")
    axes.legend(fontsize=7)


def draw_front_axle(rig: Rig, system: Linearisation) -> Figure:
    """Draw the static wheel rate, the FRF's diagonal, the actuators' own FRF, and their answer to a step of 2 mm."""
    figure, ((static, forces), (strokes, steps)) = plt.subplots(2, 2, figsize=(10, 6.8), layout="constrained")
    draw_static(static, rig)
    frequency = np.geomspace(0.5, 100.0, 300)
    time = np.arange(250) / rig.specimen.sample_rate
    for index, name in enumerate(SIDE):
        for side, style in (("left", "-"), ("right", ":")):
            channel = index + (3 if side == "right" else 0)
            force = system.response(f"response.{side}_{name}", channel, frequency)
            forces.loglog(
                frequency, np.abs(force) / 1e6, style, color=COLOURS[name], label=name if side == "left" else None
            )
        stroke = system.response(f"left_{name}.stroke", index, frequency)
        strokes.semilogx(frequency, 20 * np.log10(np.abs(stroke)), color=COLOURS[name], label=name)
        drive = np.zeros((len(rig.specimen.drives), len(time)))
        drive[index, 20:] = 2.0e-3
        row = rig.compiled.output_names.index(f"left_{name}.stroke")
        outputs = play(rig, drive)[row]
        steps.plot(1000 * time, 1000 * (outputs - outputs[0]), color=COLOURS[name], label=name)
    steps.step(1000 * time, np.where(time >= 0.0195, 2.0, 0.0), color="0.6", lw=0.8, where="post", label="command")
    strokes.axhline(-3.0, color="0.6", lw=0.8)
    strokes.set_ylim(-30, 5)
    label(forces, "spindle force per stroke command (right: dotted)", "frequency, Hz", "kN/mm")
    label(strokes, "stroke per command", "frequency, Hz", "dB")
    label(steps, "a step of 2 mm", "time, ms", "stroke, mm")
    forces.legend(fontsize=7)
    strokes.legend(fontsize=7)
    steps.legend(fontsize=7, loc="center right")
    return figure


def draw_sensors(rig: Rig, system: Linearisation) -> Figure:
    """Draw what the left vertical and longitudinal actuators do to accelerometers, strut displacement, load cells."""
    figure, panels = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    frequency = np.geomspace(0.5, 100.0, 300)
    kinds = ("acceleration", "strut displacement", "mount force")
    names = [name for name in rig.model.response_names if name.startswith("left_")][len(SIDE) :]
    units = {channel.name: channel.unit for channel in rig.specimen.responses}
    for axes, unit, title in zip(panels, ("m/s^2", "m", "N"), kinds, strict=True):
        for name in (name for name in names if units[name] == unit):
            short = name.removeprefix("left_").replace("_", " ")
            for drive, style in ((0, "-"), (2, ":")):
                line = np.abs(system.response(f"response.{name}", drive, frequency)) * 1.0e-3
                colour = next((COLOURS[way] for way in SIDE if way in name), "0.3")
                axes.loglog(frequency, line, style, color=colour, label=short if style == "-" else None)
        label(axes, f"{title} (dotted: by longitudinal)", "frequency, Hz", f"{unit} per mm")
        axes.legend(fontsize=7)
    return figure


def draw_spindle_coupled(rig: Rig, system: Linearisation) -> Figure:
    """Draw the static wheel rate, the diagonal of the FRF, the force loops, and their answer to a step."""
    figure, ((static, responses), (loops, steps)) = plt.subplots(2, 2, figsize=(10, 6.8), layout="constrained")
    draw_static(static, rig)
    frequency = np.geomspace(0.5, 100.0, 300)
    time = np.arange(300) / rig.specimen.sample_rate
    texts = {"vertical": "vertical, kN/mm", "brake": "brake, N*m/N"}
    for index, channel in enumerate(rig.specimen.drives):
        way = channel.name.removeprefix("left_")
        if way == channel.name:
            continue
        colour = COLOURS.get(way, "#7a4b9d")
        twin = "brake_moment" if way == "brake" else way
        force = np.abs(system.response(f"response.left_{twin}", index, frequency))
        text = texts.get(way, f"{way}, N/N")
        responses.loglog(frequency, force / 1e6 if channel.unit == "m" else force, color=colour, label=text)
        if channel.unit != "N":
            continue
        loop = system.response(f"left_{way}.force", index, frequency)
        loops.semilogx(frequency, 20 * np.log10(np.abs(loop)), color=colour, label=way)
        drive = np.zeros((len(rig.specimen.drives), len(time)))
        drive[index, 20:] = 500.0
        played = play(rig, drive)[rig.compiled.output_names.index(f"left_{way}.force")]
        steps.plot(1000 * time, played - played[0], color=colour, label=way)
    steps.step(1000 * time, np.where(time >= 0.0195, 500.0, 0.0), color="0.6", lw=0.8, where="post", label="command")
    loops.axhline(-3.0, color="0.6", lw=0.8)
    loops.set_ylim(-10, 6)
    label(responses, "spindle force or moment per command", "frequency, Hz", "unit in the legend")
    label(loops, "load cell per force command", "frequency, Hz", "dB")
    label(steps, "a step of 500 N", "time, ms", "load cell, N")
    for axes in (responses, loops, steps):
        axes.legend(fontsize=7)
    return figure


def draw_predecessor(rig: Rig, system: Linearisation) -> Figure:
    """Draw what the road does: FRF of height, slope and camber, and both wheels over a bump."""
    figure, (vertical, others, bump) = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    frequency = np.geomspace(0.3, 100.0, 300)
    names = rig.model.input_names
    for side, style in (("left", "-"), ("right", ":")):
        height = system.response(f"response.{side}_vertical", names.index(f"{side}_height"), frequency)
        vertical.loglog(frequency, np.abs(height) / 1e6, style, color=COLOURS["vertical"], label=f"{side} by height")
        for name, word in (("longitudinal", "slope"), ("lateral", "camber")):
            force = system.response(f"response.{side}_{name}", names.index(f"{side}_{word}"), frequency)
            others.loglog(frequency, np.abs(force) / 1e3, style, color=COLOURS[name], label=f"{side} {name} by {word}")
    length, top = 1.0, 0.02
    time = np.arange(700) / rig.specimen.sample_rate
    way = np.clip(SPEED * (time - 0.05), 0.0, length)
    drive = np.repeat(cruise(rig)[:, None], len(time), axis=1)
    for side in ("left", "right"):
        drive[names.index(f"{side}_height")] = top * (1 - np.cos(2 * np.pi * way / length)) / 2
        drive[names.index(f"{side}_slope")] = top * np.pi / length * np.sin(2 * np.pi * way / length)
    outputs = play(rig, drive)
    for index, name in enumerate(SIDE):
        bump.plot(1000 * time, (outputs[index] - rig.static_response[index]) / 1e3, color=COLOURS[name], label=name)
    label(vertical, "vertical force per road height", "frequency, Hz", "kN/mm")
    label(others, "force per slope and camber", "frequency, Hz", "kN")
    label(bump, "both wheels over a bump, 20 mm in 1 m", "time, ms", "change of force, kN")
    for axes in (vertical, others, bump):
        axes.legend(fontsize=7)
    return figure


def label(axes: Axes, title: str, horizontal: str, upright: str) -> None:
    """Write what a picture shows."""
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(horizontal, fontsize=8)
    axes.set_ylabel(upright, fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, which="major", color="0.9")


PICTURES = {
    "front_axle": draw_front_axle,
    "front_axle_compliant": draw_front_axle,
    "front_axle_sensors": draw_sensors,
    "macpherson": draw_front_axle,
    "macpherson_compliant": draw_front_axle,
    "predecessor": draw_predecessor,
    "spindle_coupled": draw_spindle_coupled,
    "spindle_coupled_braking": draw_spindle_coupled,
}


def main() -> None:
    """Write numbers and pictures of all rigs, or of those named."""
    for name in sys.argv[1:] or PICTURES:
        draw = PICTURES[name]
        rig = load_rig(shipped_specimens()[name])
        system = linearise(rig)
        figure = draw(rig, system)
        figure.savefig(DOCS / f"{name}.png", dpi=110, metadata={"Software": None})
        plt.close(figure)
        write_numbers(DOCS / f"{name}.md", data_sheet(rig, system), script=Path(__file__))


if __name__ == "__main__":
    main()
