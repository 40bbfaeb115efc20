"""The engine `drake`: Drake's plant, Drake's integrator, Drake's reaction forces; the elements of the YAML beside them.

Slower than real time and independent of the compiled player in tree, masses, springs, bushings, steps and spindle
forces: what both play alike is not an artefact of either.
"""

from __future__ import annotations

import threading
from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder

from rig_sim.compile import Method, Playback
from rig_sim.engines.choice import EngineChoice
from rig_sim.engines.drake_elements import ElementsSystem, OwnEffects
from rig_sim.engines.drake_measurement import drake_responses
from rig_sim.model import RigModel

_SCHEME = "runge_kutta3"
_ACCURACY = 1.0e-5
#: First step of every sample under error control, as a share of the sample; Drake goes on from there.
_FIRST_STEP = 0.25


class DrakeEngine:
    """A diagram of Drake's plant and the elements, advanced sample by sample by Drake's simulator.

    Every sample begins anew from state and drive, without the memory of an integrator: the same samples give the same
    bytes, however a record is cut.

    `model`: The equations; the elements of the YAML are taken from them. `plant`: Finalised; belongs to the engine from
    now on. `choice`: Accuracy or fixed step.
    Raises `ValueError`: If the fixed step is longer than a sample.
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
        builder = DiagramBuilder()
        # The stubs take dtype parameters for shapes, and whatever a builder holds for a bare system.
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
        # One context: playbacks of several threads take turns.
        self._turn = threading.Lock()

    def _forget_the_last_step(self) -> None:
        """Make the integrator begin with the same first step at every sample; it would go on with the last one's."""
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
        """Advance over a record of commands; see :class:`rig_sim.engines.Player`. Drake chooses its steps by itself.

        `state`: At the first sample. `commands`: Linear between samples, each in its channel's unit. `sample_interval`:
        Of the specimen's rate, in s. `substeps`: Not used. `method`: Not used. `bounds`: The largest magnitude of each
        state, checked at the samples.
        Returns: Outputs (outputs, samples), the state after them, and where it left its bounds.
        """
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
        outputs = self._outputs()
        self._forget_the_last_step()
        try:
            self._simulator.AdvanceTo(self._interval)
        except RuntimeError:
            # Drake stops where its smallest step misses the accuracy or a mass matrix is no longer one: it diverges.
            return outputs, self._diverged(state)
        return outputs, self._state()

    def _state(self) -> np.ndarray:
        own = self._elements_context.get_continuous_state_vector().CopyToVector()
        return np.concatenate([self._plant.GetPositionsAndVelocities(self._plant_context), own])

    def _outputs(self) -> np.ndarray:
        effects = self._elements.effects.Eval(self._elements_context)
        responses = drake_responses(self._model, self._plant, self._plant_context, self._state())
        return np.concatenate([responses, effects[self._effects.monitors]])

    def _diverged(self, state: np.ndarray) -> np.ndarray:
        """Return the state in which Drake gave up, with what had changed most marked as not a number."""
        reached = self._state()
        change = np.abs(reached - state)
        reached[int(np.argmax(np.where(np.isfinite(change), change, np.inf)))] = np.nan
        return reached
