"""Engine `drake`: Drake's plant, Drake's integrator, Drake's reaction forces; the elements of the YAML beside them.

Slower than real time and independent of the compiled player in tree, masses, springs, bushings, steps and spindle
forces: a result that both give is not an artefact of either.
"""

from __future__ import annotations

import threading
from typing import Any, TypeAlias, cast

import numpy as np
from pydrake.common import value as drake_value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ForceElementIndex, LinearBushingRollPitchYaw
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from rig_sim.compile import CompiledModel, Method, Playback, compile_model
from rig_sim.engines.choice import EngineChoice
from rig_sim.model import BushingForce, RigModel, Sensor, StrutTravel
from rig_sim.multibody import ZERO, Array, cross, move
from rig_sim.specimen import (
    AccelerationChannel,
    BushingChannel,
    Quantity,
    ResponseChannel,
    SpindleChannel,
    StrutChannel,
)


def drake_responses(
    model: RigModel, plant: MultibodyPlant, context: Context, state: Array, inputs: Array
) -> np.ndarray:
    """Read all responses from Drake's context of the plant at this state of the model, in the model's order and units.

    The forces of the YAML's elements are on the plant's input ports. The force of rubber beside a bushing, which is not
    in Drake, is from the model.
    """
    readings = [
        _reading(channel, sensor, plant, context, own=(model, state, inputs))
        for channel, sensor in zip(model.assembly.specimen.responses, model.assembly.transducers, strict=True)
    ]
    return np.array(readings, dtype=float)


def _reading(
    channel: ResponseChannel,
    sensor: Sensor,
    plant: MultibodyPlant,
    context: Context,
    *,
    own: tuple[RigModel, Array, Array],
) -> float:
    """Read the place named in the YAML from Drake's own plant, so that a wrongly mounted sensor is detected."""
    # pydrake's stubs use dtype parameters as shapes, so its arrays do not match numpy's types.
    drake = cast(Any, plant)
    match channel:
        case SpindleChannel():
            index = int(plant.GetJointByName(channel.transducer).index())
            reaction = cast(Any, plant.get_reaction_forces_output_port().Eval(context))[index]
            # The port has the force on the child (the wheel), about the weld; the spindle gets the opposite.
            part = reaction.translational() if channel.quantity is Quantity.FORCE else reaction.rotational()
            return -float(part["xyz".index(channel.axis)])
        case AccelerationChannel():
            body = drake.GetBodyByName(channel.body)
            at_design = body.EvalPoseInWorld(plant.CreateDefaultContext())
            rotation = body.EvalPoseInWorld(context).rotation()
            spin = body.EvalSpatialVelocityInWorld(context).rotational()
            offset = rotation.multiply(at_design.inverse().multiply(np.array(channel.point)))
            at_point = body.EvalSpatialAccelerationInWorld(context).Shift(offset, spin).translational()
            return float(rotation.inverse().multiply(at_point)["xyz".index(channel.axis)])
        case StrutChannel():
            strut = cast(StrutTravel, sensor)
            ends = [
                drake.get_body(BodyIndex(body)).EvalPoseInWorld(context).multiply(point)
                for body, point in ((strut.body_a, strut.point_a), (strut.body_b, strut.point_b))
            ]
            return strut.design_length - float(np.linalg.norm(ends[1] - ends[0]))
        case BushingChannel():
            bushing = _drake_bushing(plant, channel.frame_a, channel.frame_c)
            row = "xyz".index(channel.axis)
            of_drake = bushing.CalcBushingSpatialForceOnFrameA(context).translational()
            return float(of_drake[row]) + _own_force(cast(BushingForce, sensor), *own)


def _drake_bushing(plant: MultibodyPlant, frame_a: str, frame_c: str) -> Any:
    for index in range(plant.num_force_elements()):
        element = plant.get_force_element(ForceElementIndex(index))
        if isinstance(element, LinearBushingRollPitchYaw):
            names = (element.frameA().name(), element.frameC().name())
            if names == (frame_a, frame_c):
                return element
    raise ValueError(f"the plant has no bushing from {frame_a!r} to {frame_c!r}.")


def _own_force(sensor: BushingForce, model: RigModel, state: Array, inputs: Array) -> float:
    """Return the force of rubber and wear of a bushing on its mount, in N, along the row of the sensor."""
    if not sensor.rubber and sensor.loss is None:
        return 0.0
    tree, first = model.assembly.tree, model.position_count
    motion = move(tree, state[:first], state[first : first + tree.velocity_count])
    axes = motion.poses[sensor.bushing.body_a].rotation @ sensor.bushing.frame_a.rotation
    states = {rubber.name: state[model.element_slice(rubber.name)] for rubber in sensor.rubber}
    force = sensor.beside(motion, states, dict(zip(model.input_names, inputs, strict=True)))
    return float((axes.T @ force)[sensor.row])


# The stubs lack the template of values.
AppliedForces = cast(Any, drake_value).Value[list[ExternallyAppliedSpatialForce]]


def applied_force(body: int, wrench: np.ndarray) -> ExternallyAppliedSpatialForce:
    """Return a moment and a force (6,) on a body as Drake takes them: about the body's origin, world axes."""
    applied = cast(Any, ExternallyAppliedSpatialForce())
    applied.body_index = BodyIndex(body)
    applied.F_Bq_W = cast(Any, SpatialForce)(wrench)
    return applied


class OwnEffects:
    """Compiled effects of the elements: their states' rates, wrenches on bodies, forces on joints, monitored values."""

    def __init__(self, model: RigModel) -> None:
        tree = model.assembly.tree
        self.first_own_state = model.position_count + tree.velocity_count
        own_states = len(model.state_names) - self.first_own_state
        effect = model.evaluate(model.design_state, np.zeros(len(model.input_names))).own_effect
        #: Bodies with a force of an element. A force on the world has no effect.
        self.bodies = tuple(i for i, wrench in enumerate(effect.wrenches) if i > 0 and wrench is not ZERO)
        self.monitored = tuple(effect.monitored)
        lengths = (own_states, 6 * len(self.bodies), tree.velocity_count, len(self.monitored))
        ends = np.cumsum(lengths)
        self.length = int(ends[-1])
        self.rates, self.wrenches, self.joint_forces, self.monitors = (
            slice(int(end) - length, int(end)) for length, end in zip(lengths, ends, strict=True)
        )
        self._compiled = self._compile(model)

    def __call__(self, state: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Evaluate all effects."""
        return self._compiled.outputs(state, drives)

    def _compile(self, model: RigModel) -> CompiledModel:
        def traced(state: Array, inputs: Array) -> tuple[list[Any], list[Any]]:
            evaluation = model.evaluate(state, inputs)
            effect = evaluation.own_effect
            outputs = list(evaluation.derivative[self.first_own_state :])
            for body in self.bodies:
                wrench, origin = effect.wrenches[body], evaluation.motion.poses[body].origin
                outputs += [*(wrench.angular - cross(origin, wrench.linear)), *wrench.linear]
            # The rates of positions and velocities are not used, so the mechanics are never computed.
            return [0.0] * len(state), [*outputs, *effect.joint_forces, *effect.monitored.values()]

        return compile_model(traced, state_names=model.state_names, input_names=model.input_names)


class ElementsSystem(LeafSystem):
    """The elements with their states; the drives are linear from `start` to `end` over one sample, from time zero."""

    def __init__(self, effects: OwnEffects, model: RigModel, *, sample_interval: float) -> None:
        super().__init__()
        self._effects = effects
        self._interval = sample_interval
        drives = len(model.input_names)
        self._start = self.DeclareNumericParameter(cast(Any, BasicVector)(drives))
        self._end = self.DeclareNumericParameter(cast(Any, BasicVector)(drives))
        self.plant_state = self.DeclareVectorInputPort("plant_state", effects.first_own_state)
        self.DeclareContinuousState(len(model.state_names) - effects.first_own_state)
        # An output port is cached: derivative, forces and moments of one instant are computed together, once.
        self.effects = self.DeclareVectorOutputPort("effects", effects.length, self._evaluate)
        self.spatial = self.DeclareAbstractOutputPort("spatial", AppliedForces, self._spatial)
        self.generalized = self.DeclareVectorOutputPort(
            "generalized", model.assembly.tree.velocity_count, self._generalized
        )

    def set_drives(self, context: Context, start: np.ndarray, end: np.ndarray) -> None:
        """Set the drives at the start and end of the next sample."""
        for index, drives in ((self._start, start), (self._end, end)):
            cast(Any, context.get_mutable_numeric_parameter(index)).SetFromVector(drives)

    def _evaluate(self, context: Any, output: Any) -> None:
        start = context.get_numeric_parameter(self._start).value()
        end = context.get_numeric_parameter(self._end).value()
        drives = start + (context.get_time() / self._interval) * (end - start)
        own = context.get_continuous_state_vector().CopyToVector()
        plant_state = cast(Any, self.plant_state.Eval(context))
        output.SetFromVector(self._effects(np.concatenate([plant_state, own]), drives))

    def _spatial(self, context: Any, output: Any) -> None:
        wrenches = cast(Any, self.effects.Eval(context))[self._effects.wrenches].reshape(-1, 6)
        output.set_value([applied_force(*pair) for pair in zip(self._effects.bodies, wrenches, strict=True)])

    def _generalized(self, context: Any, output: Any) -> None:
        output.SetFromVector(cast(Any, self.effects.Eval(context))[self._effects.joint_forces])

    def DoCalcTimeDerivatives(self, arg0: Context, arg1: Any) -> None:  # noqa: N802 - named by Drake
        """Set Drake's rates (second argument) of the elements' states in a context (first)."""
        arg1.SetFromVector(cast(Any, self.effects.Eval(arg0))[self._effects.rates])


_SCHEME = "runge_kutta3"
_ACCURACY = 1.0e-5
#: First step of every sample under error control, as a share of the sample; Drake continues from there.
_FIRST_STEP = 0.25


class DrakeEngine:
    """A diagram of Drake's plant and the elements, advanced sample by sample by Drake's simulator.

    Every sample starts from state and drive, without the memory of an integrator: the same samples give the same bytes
    for any division of a record. The engine takes over the finalised plant. Raises `ValueError` if the
    fixed step is longer than a sample.
    """

    def __init__(self, model: RigModel, plant: MultibodyPlant, choice: EngineChoice) -> None:
        interval = 1.0 / model.assembly.specimen.sample_rate
        if choice.fixed_step is not None and choice.fixed_step > interval:
            raise ValueError(
                f"fixed_step is {choice.fixed_step:g} s; a sample, {interval:g} s, is the longest step there is."
            )
        self.output_names = model.output_names
        self._model = model
        self._choice = choice
        self._interval = interval
        self._effects = OwnEffects(model)
        # A tenth of Drake's import, and few rigs are played by it.
        from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

        builder = DiagramBuilder()
        # The stubs use dtype parameters as shapes, and return a builder's content as a bare system.
        self._plant: Any = plant
        self._elements: Any = ElementsSystem(self._effects, model, sample_interval=self._interval)
        builder.AddSystem(plant)
        builder.AddSystem(self._elements)
        builder.Connect(plant.get_state_output_port(), self._elements.plant_state)
        builder.Connect(self._elements.spatial, plant.get_applied_spatial_force_input_port())
        builder.Connect(self._elements.generalized, plant.get_applied_generalized_force_input_port())
        self._simulator = cast(Any, Simulator)(builder.Build())
        cast(Any, ResetIntegratorFromFlags)(self._simulator, _SCHEME, self._interval)
        root = self._simulator.get_mutable_context()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(root)
        self._elements_context: Any = self._elements.GetMyMutableContextFromRoot(root)
        # One context: playbacks on several threads use it one after the other.
        self._turn = threading.Lock()

    def _forget_the_last_step(self) -> None:
        """Reset the integrator to the same first step at every sample; it would continue with the last one's."""
        integrator = self._simulator.get_mutable_integrator()
        integrator.Reset()
        if self._choice.fixed_step is not None:
            integrator.set_maximum_step_size(self._choice.fixed_step)
            integrator.set_fixed_step_mode(True)
        else:
            integrator.set_maximum_step_size(self._interval)
            integrator.set_target_accuracy(self._choice.accuracy or _ACCURACY)
            integrator.request_initial_step_size_target(_FIRST_STEP * self._interval)
        self._simulator.Initialize()

    def play(
        self,
        state: np.ndarray,
        commands: np.ndarray,
        *,
        sample_interval: float,
        substeps: int,
        method: Method = Method.RUNGE_KUTTA_4,
        bounds: np.ndarray,
    ) -> Playback:
        """Advance over a record of commands; see `CompiledModel.play`. Drake chooses its own steps."""
        del substeps, method
        if sample_interval != self._interval:
            raise ValueError(f"the sample interval is {sample_interval:g} s; this rig has {self._interval:g} s.")
        samples = commands.shape[1] - 1
        outputs = np.empty((len(self.output_names), samples))
        with self._turn:
            for sample in range(samples + 1):
                outside = ~(np.abs(state) <= bounds)
                if outside.any():
                    names = tuple(np.array(self._model.state_names)[outside])
                    return Playback(outputs[:, :sample].copy(), state, sample, names)
                if sample < samples:
                    outputs[:, sample], state = self._advance(state, commands[:, sample], commands[:, sample + 1])
        return Playback(outputs, state, None, ())

    def _advance(self, state: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the outputs at the beginning of a sample, and the state at its end."""
        first = self._effects.first_own_state
        self._simulator.get_mutable_context().SetTime(0.0)
        self._elements.set_drives(self._elements_context, start, end)
        self._plant.SetPositionsAndVelocities(self._plant_context, state[:first])
        self._elements_context.SetContinuousState(state[first:])
        outputs = self._outputs(start)
        self._forget_the_last_step()
        try:
            self._simulator.AdvanceTo(self._interval)
        except RuntimeError:
            # Drake fails if its smallest step misses the accuracy or a mass matrix becomes invalid: it diverges.
            return outputs, self._diverged(state)
        return outputs, self._state()

    def _state(self) -> np.ndarray:
        own = self._elements_context.get_continuous_state_vector().CopyToVector()
        return np.concatenate([self._plant.GetPositionsAndVelocities(self._plant_context), own])

    def _outputs(self, inputs: np.ndarray) -> np.ndarray:
        effects = self._elements.effects.Eval(self._elements_context)
        responses = drake_responses(self._model, self._plant, self._plant_context, self._state(), inputs)
        return np.concatenate([responses, effects[self._effects.monitors]])

    def _diverged(self, state: np.ndarray) -> np.ndarray:
        """Return the state in which Drake failed, with the state that had changed most set to NaN."""
        reached = self._state()
        change = np.abs(reached - state)
        reached[int(np.argmax(np.where(np.isfinite(change), change, np.inf)))] = np.nan
        return reached


Player: TypeAlias = CompiledModel | DrakeEngine
"""Engine that advances a rig; consecutive records, each from the end state of the last one, have no seam."""
