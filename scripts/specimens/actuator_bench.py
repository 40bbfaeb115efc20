"""Bench of one actuator: piston and load in one body, a spring and a damper to the wall, an adaptive integrator.

It is for studies and tests of hydraulics alone, in plain numpy; a rig has a specimen instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from scipy.integrate import solve_ivp

from rig_sim.hydraulics import HydraulicActuator, HydraulicSupply
from rig_sim.multibody import Effect, Motion


@dataclass(frozen=True)
class Bench:
    """Bench with an actuator on joint 0 that moves a body with a spring and a damper.

    `actuator`: Actuator on joint 0. `supply`: Its supply. `mass`: Mass in kg. `stiffness`: Stiffness in N/m.
    `damping`: Damping in N*s/m.
    """

    actuator: HydraulicActuator
    supply: HydraulicSupply
    mass: float
    stiffness: float = 0.0
    damping: float = 0.0

    @property
    def start(self) -> np.ndarray:
        """Return position, speed, and states of actuator and supply, (states,), at mid stroke with the valve shut."""
        return np.array([0.0, 0.0, *self.actuator.initial_state, *self.supply.initial_state])

    def evaluate(self, command: float, state: np.ndarray) -> tuple[np.ndarray, Effect]:
        """Evaluate the bench.

        `command`: Command in the drive's unit, m or N. `state`: State, as from `start`.
        Returns: Rates (states,) in the states' units per second, and the effect with its monitored values.
        """
        motion = cast(Motion, Motion([], [], [], [], [], state[:1], state[1:2]))
        effect = Effect([], [0.0])
        end = 2 + len(self.actuator.initial_state)
        self.supply.offer(state[end:], effect)
        own = self.actuator.apply(motion, state[2:end], np.array([command]), effect)
        supply = self.supply.apply(motion, state[end:], np.array([]), effect)
        force = effect.joint_forces[0] - self.stiffness * state[0] - self.damping * state[1]
        return np.array([state[1], force / self.mass, *own, *supply]), effect

    def play(
        self, command: Callable[[float], float], seconds: float, *, points: int = 4001
    ) -> tuple[np.ndarray, np.ndarray]:
        """Integrate from `start`.

        `command`: Drive in m or N as a function of time in s. `seconds`: Duration. `points`: Number of evenly spaced
        instants.
        Returns: Time (points,) in s and states (states, points).
        Raises `ArithmeticError`: The integrator failed.
        """
        time = np.linspace(0.0, seconds, points)
        solved: Any = solve_ivp(
            lambda t, y: self.evaluate(command(t), y)[0],
            (0.0, seconds),
            self.start,
            t_eval=time,
            rtol=1e-8,
            atol=1e-9,
            max_step=1e-3,
        )
        if not solved.success:
            raise ArithmeticError(f"the bench could not be played for {seconds:g} s: {solved.message}")
        return time, solved.y

    def monitored(
        self, command: Callable[[float], float], time: np.ndarray, states: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Return the monitored values of a play by name, (points,) each, given its time (points,) and states."""
        effects = [self.evaluate(command(t), state)[1].monitored for t, state in zip(time, states.T, strict=True)]
        return {name: np.array([values[name] for values in effects], dtype=float) for name in effects[0]}
