"""The whole rig as one function of state and inputs, over generic scalars: traced and compiled, or run in numpy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rig_sim.model.assembly import Assembly
from rig_sim.model.measurement import Instant
from rig_sim.multibody import (
    ZERO,
    Accelerations,
    Array,
    Effect,
    JointKind,
    Motion,
    Offering,
    accelerate,
    add_linear_elements,
    move,
)


@dataclass(frozen=True)
class Evaluation:
    """The rig at one instant."""

    motion: Motion
    #: Effect of the YAML's elements, without the linear elements of the SDF.
    own_effect: Effect
    accelerations: Accelerations
    #: Rates of all states.
    derivative: list[Any]
    #: The measured responses, each in its unit.
    responses: list[Any]


class RigModel:
    """State layout and equations of an assembled rig.

    The state is Drake's positions and velocities, then the states of each element in the order of the assembly.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        tree = assembly.tree
        names = [f"position {index}" for index in range(len(tree.default_positions))]
        names += [f"velocity {index}" for index in range(tree.velocity_count)]
        for joint in tree.joints:
            for index in range(joint.positions):
                names[joint.position_start + index] = f"{joint.name} position {index}"
            for index in range(joint.velocities):
                names[len(tree.default_positions) + joint.velocity_start + index] = f"{joint.name} velocity {index}"
        initial = [*tree.default_positions, *np.zeros(tree.velocity_count)]
        self._slices: dict[str, slice] = {}
        for element in assembly.elements:
            self._slices[element.name] = slice(len(initial), len(initial) + len(element.initial_state))
            initial += element.initial_state
            names += [f"{element.name} state {index}" for index in range(len(element.initial_state))]
        self.state_names = tuple(names)
        #: Design position at rest, valves shut: the start of the search for equilibrium.
        self.design_state = np.array(initial)
        self.drive_names = tuple(channel.name for channel in assembly.specimen.drives)
        #: The drives, then the shares that parts have lost by wear.
        self.input_names = (*self.drive_names, *(item.name for part in assembly.wearing for item in part.inputs))
        self.response_names = tuple(channel.name for channel in assembly.specimen.responses)
        at_design = self.evaluate(self.design_state, np.zeros(len(self.input_names)))
        #: Responses, then the monitored values of the elements, e.g. "left_vertical.stroke".
        self.output_names = (
            *(f"response.{name}" for name in self.response_names),
            *at_design.own_effect.monitored,
        )

    @property
    def position_count(self) -> int:
        """Number of Drake's positions."""
        return len(self.assembly.tree.default_positions)

    def element_slice(self, name: str) -> slice:
        """Return the range of an element's states in the state."""
        return self._slices[name]

    def normalise_quaternions(self, state: np.ndarray) -> None:
        """Scale the quaternions in a state of numbers to the length one."""
        for joint in self.assembly.tree.joints:
            if joint.kind is JointKind.FLOATING:
                where = slice(joint.position_start, joint.position_start + 4)
                state[where] /= np.linalg.norm(state[where])

    def evaluate(self, state: Array, inputs: Array) -> Evaluation:
        """Evaluate the rig."""
        tree = self.assembly.tree
        positions = state[: self.position_count]
        velocities = state[self.position_count : self.position_count + tree.velocity_count]
        motion = move(tree, positions, velocities)
        own = Effect([ZERO] * len(tree.bodies), [0.0] * tree.velocity_count)
        for element in self.assembly.elements:
            if isinstance(element, Offering):
                element.offer(state[self._slices[element.name]], own)
        rates: list[Any] = []
        given = dict(zip(self.input_names, inputs, strict=True))
        for element in self.assembly.elements:
            values = [given[item.name] for item in element.inputs]
            rates += element.apply(motion, state[self._slices[element.name]], np.array(values, dtype=object), own)
        wrenches = list(own.wrenches)
        add_linear_elements(tree, motion, wrenches)
        accelerations = accelerate(tree, motion, wrenches, own.joint_forces)
        states = {name: state[where] for name, where in self._slices.items()}
        instant = Instant(tree, motion, wrenches, accelerations, states, given)
        for part in self.assembly.wearing:
            own.monitored[f"{part.name}.load"] = part.load(instant)
        return Evaluation(
            motion=motion,
            own_effect=own,
            accelerations=accelerations,
            derivative=[*motion.position_rates, *accelerations.joint, *rates],
            responses=[sensor.read(instant) for sensor in self.assembly.transducers],
        )

    def traced(self, state: Array, inputs: Array) -> tuple[list[Any], list[Any]]:
        """Return the derivative, and responses followed by the monitored values, for the compiler."""
        evaluation = self.evaluate(state, inputs)
        return evaluation.derivative, [*evaluation.responses, *evaluation.own_effect.monitored.values()]
