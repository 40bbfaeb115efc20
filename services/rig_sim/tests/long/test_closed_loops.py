"""What the loops of every shipped rig have to reach: -3 dB at 40 Hz (stroke) and 25 Hz (force), 5 % of damping.

The oracle is the linearisation at rest, and for force control a sweep of the rig itself at a level where rubber slips
and seals slide. Oil and sensors as they are delivered: bulk modulus and compensation off by what a rig has to bear.
"""

import functools
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import signal

from rig_sim import shipped_specimens
from rig_sim.checks.equilibrium import find_equilibrium
from rig_sim.compile.compiled_model import CompiledModel
from rig_sim.compile.model import compile_model
from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.model.assembly import assemble
from rig_sim.model.rig_model import RigModel
from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.specimen.specimen import Specimen, load_specimen, read_document

MINUS_3_DB = np.sqrt(0.5)
FREQUENCY = np.arange(0.5, 60.0, 0.25)
#: Every specimen that has hydraulics.
RIGS = sorted(name for name, path in shipped_specimens().items() if read_document(path).get("actuators"))
#: Kinds that give way on purpose, see docs/decisions/0027-wheels-are-displaced.md.
COMPLIANT = {
    (rig, kind)
    for rig in ("front_axle_compliant", "front_axle_sensors", "macpherson_compliant")
    for kind in ("lateral", "longitudinal")
}
#: Stiff rigs, on which stroke over command stays within 1 dB to 20 Hz.
STIFF = ("front_axle", "macpherson")
#: An actuator that holds a wheel which rings on its bushings at 26 Hz cannot be both damped and faster than that wheel.
LOWER = {(rig, "longitudinal"): 25.0 for rig in ("front_axle", "front_axle_wearing")}


@dataclass(frozen=True)
class ClosedLoops:
    """A rig at rest and its linearisation: eigenvalues, and what turns them into the FRFs of the actuators."""

    model: RigModel
    compiled: CompiledModel
    rest: np.ndarray
    values: np.ndarray
    vectors: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray

    def actuators(self, *, side="left"):
        elements = self.model.assembly.elements
        return [part for part in elements if isinstance(part, HydraulicActuator) and side in part.name]

    def gain(self, actuator):
        row = self.outputs[self.compiled.output_names.index(actuator.achieved)] @ self.vectors
        column = np.linalg.solve(self.vectors, self.inputs[:, self.model.input_names.index(actuator.name)])
        return np.abs((row * column / (2j * np.pi * FREQUENCY[:, None] - self.values)).sum(axis=1))

    def least_damping(self):
        swinging = self.values[np.abs(self.values.imag) > 1.0]
        return float((-swinging.real / np.abs(swinging)).min())


@functools.cache
def closed_loops(name, *, oil=1.0, compensation=1.0):
    path = shipped_specimens()[name]
    document = load_specimen(path).model_dump()
    for kind in document["actuator_kinds"].values():
        kind["cylinder"]["bulk_modulus"] *= oil
        if kind["control"] == "force":
            kind["loop"]["velocity_compensation"] *= compensation
            kind["loop"]["acceleration_compensation"] *= compensation
    specimen = Specimen.model_validate(document)
    model = RigModel(assemble(specimen, read_tree(load_plant(path.with_name(specimen.sdf)))))
    compiled = compile_model(
        model.traced, state_names=model.state_names, input_names=model.input_names, output_names=model.output_names
    )
    still = np.zeros(len(model.input_names))
    rest = find_equilibrium(model, compiled.derivative, still)

    def both(state, drives):
        return np.concatenate([compiled.derivative(state, drives), compiled.outputs(state, drives)])

    step, count = 1e-6, len(rest)
    a = np.array([both(rest + e, still) - both(rest - e, still) for e in step * np.eye(count)]).T / (2 * step)
    b = np.array([both(rest, e) - both(rest, -e) for e in step * np.eye(len(still))]).T / (2 * step)
    values, vectors = np.linalg.eig(a[:count])
    return ClosedLoops(model, compiled, rest, values, vectors, b[:count], a[count:])


def kind_of(loops, actuator):
    return next(part.kind for part in loops.model.assembly.specimen.actuators if part.name == actuator.name)


def test_there_are_rigs_to_hold_to_it():
    assert {"front_axle", "macpherson", "spindle_coupled", "spindle_coupled_braking"} <= set(RIGS)


@pytest.mark.parametrize("name", RIGS)
def test_every_actuator_follows_as_far_as_it_has_to(name):
    loops = closed_loops(name)
    for actuator in loops.actuators():
        if (name, kind_of(loops, actuator)) in COMPLIANT:
            continue
        usual = 25.0 if actuator.inputs[0].unit == "N" else 40.0
        highest = LOWER.get((name, kind_of(loops, actuator)), usual)
        gain = loops.gain(actuator)[: np.searchsorted(FREQUENCY, highest) + 1]
        assert gain.min() > MINUS_3_DB, actuator.name
        # Nor more than 4 dB too much.
        assert gain.max() < 10.0 ** (4.0 / 20.0), actuator.name


@pytest.mark.parametrize("name", STIFF)
def test_a_stiff_rig_displaces_its_wheels_within_1_db_to_20_hz(name):
    loops = closed_loops(name)
    for actuator in loops.actuators():
        decibels = 20.0 * np.log10(loops.gain(actuator)[FREQUENCY <= 20.0])
        assert np.abs(decibels).max() < 1.0, actuator.name


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("oil", [0.8, 1.2])
def test_a_stiff_rig_with_other_oil_does_not_ring(name, oil):
    assert closed_loops(name, oil=oil).least_damping() >= 0.05


@pytest.mark.parametrize("name", RIGS)
def test_no_mode_of_a_closed_loop_has_less_than_5_percent_of_damping(name):
    assert closed_loops(name).least_damping() >= 0.05


@pytest.mark.parametrize(
    "delivered", [{"oil": 0.8}, {"oil": 1.2}, {"compensation": 0.95}, {"compensation": 1.1}], ids=str
)
def test_other_oil_and_a_wrong_compensation_neither_ring_nor_lag(delivered):
    # The rig with all force actuators there are.
    loops = closed_loops("spindle_coupled_braking", **delivered)
    assert loops.least_damping() >= 0.05
    for actuator in loops.actuators():
        if actuator.inputs[0].unit == "N":
            assert loops.gain(actuator)[FREQUENCY <= 25.0].min() > MINUS_3_DB, actuator.name


def test_without_compensation_the_free_wheel_leaves_the_actuator_behind():
    loops = closed_loops("spindle_coupled_braking", compensation=1e-3)
    gains = {part.name: loops.gain(part)[FREQUENCY <= 25.0].min() for part in loops.actuators()}
    assert gains["left_longitudinal"] < MINUS_3_DB
    assert gains["left_brake"] < MINUS_3_DB


@pytest.mark.parametrize(
    ("actuator", "amplitude"), [("left_lateral", 800.0), ("left_longitudinal", 800.0), ("left_brake", 400.0)]
)
def test_a_sweep_of_force_is_followed_by_the_rig_that_plays(actuator, amplitude):
    loops = closed_loops("spindle_coupled_braking")
    rate, seconds = 1000.0, 12.0
    time = np.arange(round(rate * seconds)) / rate
    drive = np.zeros((len(loops.model.input_names), len(time) + 1))
    fade = np.minimum(np.minimum(time, seconds - time), 1.0)
    wanted = fade * amplitude * signal.chirp(time, 1.0, seconds, 28.0)
    drive[loops.model.input_names.index(actuator), :-1] = wanted
    played = loops.compiled.play(loops.rest, drive, sample_interval=1.0 / rate, substeps=2).outputs
    force = played[loops.compiled.output_names.index(f"{actuator}.force"), : len(time)]
    # The envelope of both: in a sweep, time is frequency.
    share = np.abs(signal.hilbert(force)) / np.abs(signal.hilbert(wanted))
    swept = 1.0 + 27.0 * time / seconds
    inside = (swept > 3.5) & (swept < 25.0)
    smooth = np.convolve(share, np.ones(101) / 101, mode="same")[inside]
    assert smooth.min() > MINUS_3_DB
    assert smooth.max() < 10.0 ** (4.0 / 20.0)
