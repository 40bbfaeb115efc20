"""What is played is the solution of the equations: against scipy's integrators, and against Drake's own."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from scipy.integrate import solve_ivp

from rig_sim.compile.model import compile_model
from rig_sim.effect import Effect
from rig_sim.multibody.drake_reader import load_plant
from rig_sim.multibody.kinematics import move
from rig_sim.multibody.spatial import ZERO
from rig_sim.proof import applied_forces
from rig_sim.rig_model import Evaluation
from rig_sim.specimen import shipped_specimens

RATE = 1000.0


def moving(rig, samples):
    """Return a drive (drives, samples) that begins at zero and is linear between samples, as the player takes it."""
    time = np.arange(samples) / RATE
    begin = np.minimum(time / 0.05, 1.0)
    channels = rig.specimen.drives
    frequencies = iter((6.0, 9.0, 12.0, 7.0, 10.0, 13.0))
    return np.array(
        [
            15.0 * begin if c.unit == "m/s" else 0.04 * c.maximum * begin * np.sin(2 * np.pi * next(frequencies) * time)
            for c in channels
        ]
    )


def at(drive, time):
    position = min(time * RATE, drive.shape[1] - 1.0)
    index = min(int(position), drive.shape[1] - 2)
    return drive[:, index] + (position - index) * (drive[:, index + 1] - drive[:, index])


def play(rig, drive, substeps):
    return rig.compiled.play(rig.rest, drive, sample_interval=1.0 / RATE, substeps=substeps)


@pytest.fixture(scope="module")
def solved(quiet_rig):
    """The responses (6, samples) by a method of order 8 with an error control far tighter than the player's step."""
    samples = 161
    drive = moving(quiet_rig, samples)
    state, states = quiet_rig.rest.copy(), []
    # Sample by sample: the drive has a kink at each, over which no method of high order should step.
    for sample in range(samples - 1):
        states.append(state)
        solution = solve_ivp(
            lambda t, y: quiet_rig.compiled.derivative(y, at(drive, t)),
            (sample / RATE, (sample + 1) / RATE),
            state,
            method="DOP853",
            rtol=1e-9,
            atol=1e-11,
        )
        state = solution.y[:, -1]
    responses = [quiet_rig.compiled.outputs(s, drive[:, k])[:6] for k, s in enumerate(states)]
    return drive, np.array(responses).T


def error(responses, expected, static):
    return np.sqrt(np.mean((responses - expected) ** 2, axis=1)) / np.sqrt(np.mean((expected - static) ** 2, axis=1))


def test_the_player_solves_its_equations_to_a_thousandth(quiet_rig, solved):
    drive, expected = solved
    responses = play(quiet_rig, drive, quiet_rig.specimen.substeps).outputs[:6]
    assert error(responses, expected, quiet_rig.static_response[:, None]).max() < 1e-3


def test_the_error_falls_with_about_the_fourth_power_of_the_step(quiet_rig, solved):
    drive, expected = solved
    static = quiet_rig.static_response[:, None]
    # Where friction reverses and dampers change direction, rates have kinks: below about 1e-5 they are what is left.
    substeps = {"front_axle": (2, 4), "predecessor": (1, 2)}[quiet_rig.specimen.name]
    coarse, fine = (error(play(quiet_rig, drive, n).outputs[:6], expected, static).max() for n in substeps)
    assert 3.4 < np.log2(coarse / fine) < 4.6


def own_forces_model(model):
    """Compile the forces of the elements of the YAML: wrenches on the bodies, then joint forces."""

    def traced(state, inputs):
        evaluation = model.evaluate(state, inputs)
        wrenches = [x for w in evaluation.own_effect.wrenches for x in (*w.angular, *w.linear)]
        return evaluation.derivative, [*wrenches, *evaluation.own_effect.joint_forces]

    return compile_model(traced, state_names=model.state_names, input_names=model.input_names)


class Elements(LeafSystem):
    """The elements of the YAML as a system of Drake: their states integrated by Drake, their forces on its plant."""

    def __init__(self, rig, drive, forces):
        super().__init__()
        self._rig = rig
        self._drive = drive
        tree = rig.model.assembly.tree
        self._bodies = len(tree.bodies)
        self._moving = rig.model.position_count + tree.velocity_count
        self._forces = forces
        self.plant_state = self.DeclareVectorInputPort("plant_state", self._moving)
        states = self.DeclareContinuousState(len(rig.rest) - self._moving)
        depends = {self.all_state_ticket(), self.input_port_ticket(self.plant_state.get_index()), self.time_ticket()}
        self.spatial = self.DeclareAbstractOutputPort(
            "spatial", Value[list[ExternallyAppliedSpatialForce]], self._spatial, depends
        )
        self.generalized = self.DeclareVectorOutputPort(
            "generalized", BasicVector(tree.velocity_count), self._generalized, depends
        )
        assert states is not None

    def _whole(self, context):
        own = context.get_continuous_state_vector().CopyToVector()
        return np.concatenate([self.plant_state.Eval(context), own]), at(self._drive, context.get_time())

    def _spatial(self, context, output):
        state, inputs = self._whole(context)
        wrenches = self._forces.outputs(state, inputs)[: 6 * self._bodies].reshape(-1, 6)
        tree = self._rig.model.assembly.tree
        n_q = self._rig.model.position_count
        motion = move(tree, state[:n_q], state[n_q : self._moving])
        effect = Effect([type(ZERO)(w[:3], w[3:]) for w in wrenches], [])
        output.set_value(applied_forces(Evaluation(motion, effect, None, [], [])))

    def _generalized(self, context, output):
        output.SetFromVector(self._forces.outputs(*self._whole(context))[6 * self._bodies :])

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802 - the name Drake calls
        derivatives.SetFromVector(self._rig.compiled.derivative(*self._whole(context))[self._moving :])


def test_drakes_own_integrator_arrives_where_the_player_does(quiet_front_axle):
    """A diagram of Drake's plant and our elements, integrated by Drake, over 30 ms of a moving drive."""
    rig = quiet_front_axle
    samples = 31
    drive = moving(rig, samples)
    builder = DiagramBuilder()
    plant = builder.AddSystem(load_plant(shipped_specimens()["front_axle"].with_name(rig.specimen.sdf)))
    elements = builder.AddSystem(Elements(rig, drive, own_forces_model(rig.model)))
    builder.Connect(plant.get_state_output_port(), elements.plant_state)
    builder.Connect(elements.spatial, plant.get_applied_spatial_force_input_port())
    builder.Connect(elements.generalized, plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    moving_states = plant.num_multibody_states()
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), rig.rest[:moving_states])
    elements.GetMyMutableContextFromRoot(context).SetContinuousState(rig.rest[moving_states:])
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 2.5e-4).set_fixed_step_mode(True)
    simulator.Initialize()
    simulator.AdvanceTo((samples - 1) / RATE)
    theirs = np.concatenate(
        [
            plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(context)),
            elements.GetMyContextFromRoot(context).get_continuous_state_vector().CopyToVector(),
        ]
    )
    ours = play(rig, drive, 8).state
    n_q = rig.model.position_count
    for name, part in (
        ("positions", slice(0, n_q)),
        ("velocities", slice(n_q, moving_states)),
        ("elements", slice(moving_states, None)),
    ):
        travel = np.abs(ours[part] - rig.rest[part]).max()
        assert travel > 0.0
        assert np.abs(theirs[part] - ours[part]).max() < 1e-3 * travel, name
