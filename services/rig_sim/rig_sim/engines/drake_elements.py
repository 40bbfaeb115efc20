"""The elements of the YAML as a system of Drake: it integrates their states, they press on its plant.

The laws are the ones that the compiled player has (`RigModel`); tree, joints, masses, gravity, springs and bushings
of the SDF are left to Drake.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from pydrake.common import value as drake_value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rig_sim.compile import CompiledModel, compile_model
from rig_sim.model import RigModel
from rig_sim.multibody import ZERO, Array, cross

# The stubs do not know the template of values.
_AppliedForces = cast(Any, drake_value).Value[list[ExternallyAppliedSpatialForce]]


class OwnEffects:
    """What the elements do, compiled: their states' rates, wrenches on bodies, forces on joints, monitored values."""

    def __init__(self, model: RigModel) -> None:
        tree = model.assembly.tree
        self.first_own_state = model.position_count + tree.velocity_count
        own_states = len(model.state_names) - self.first_own_state
        effect = model.evaluate(model.design_state, np.zeros(len(model.input_names))).own_effect
        #: Bodies that an element touches. What acts on the world needs no answer.
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
            # Nobody asks for the rates of positions and velocities, so the mechanics are never computed.
            return [0.0] * len(state), [*outputs, *effect.joint_forces, *effect.monitored.values()]

        return compile_model(traced, state_names=model.state_names, input_names=model.input_names)


class ElementsSystem(LeafSystem):
    """The elements with their states; the drives go straight from `start` to `end` over one sample, from time zero."""

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
        self.spatial = self.DeclareAbstractOutputPort("spatial", _AppliedForces, self._spatial)
        self.generalized = self.DeclareVectorOutputPort(
            "generalized", model.assembly.tree.velocity_count, self._generalized
        )

    def set_drives(self, context: Context, start: np.ndarray, end: np.ndarray) -> None:
        """Say where the drives go over the coming sample."""
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
        forces = []
        for body, wrench in zip(self._effects.bodies, wrenches, strict=True):
            applied = cast(Any, ExternallyAppliedSpatialForce())
            applied.body_index = BodyIndex(body)
            applied.F_Bq_W = cast(Any, SpatialForce)(wrench)
            forces.append(applied)
        output.set_value(forces)

    def _generalized(self, context: Any, output: Any) -> None:
        output.SetFromVector(cast(Any, self.effects.Eval(context))[self._effects.joint_forces])

    def DoCalcTimeDerivatives(self, arg0: Context, arg1: Any) -> None:  # noqa: N802 - named by Drake
        """Give Drake the rates (second argument) of the elements' states in a context (first)."""
        arg1.SetFromVector(cast(Any, self.effects.Eval(arg0))[self._effects.rates])
