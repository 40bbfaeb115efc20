"""A displacement-controlled servo-hydraulic actuator on a prismatic joint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile.numeric import absolute, select_positive
from rig_sim.effect import Effect, Input
from rig_sim.hydraulics.cylinder import Cylinder, piston_force, pressure_rates
from rig_sim.hydraulics.servovalve import Servovalve, port_flows, spool_rates
from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import Array
from rig_sim.parameters import STRICT, NotNegative, Positive

#: Pressure states are in megapascals: of order one like all others, whatever the integrator.
_PASCAL = 1.0e6


@parameters(config=STRICT)
class Supply:
    """Pressures of the hydraulic power unit, in Pa."""

    supply_pressure: Positive
    return_pressure: NotNegative

    def __post_init__(self) -> None:
        if not self.supply_pressure > self.return_pressure:
            raise ValueError(
                f"supply_pressure is {self.supply_pressure:g} Pa; it must be above return_pressure, "
                f"{self.return_pressure:g} Pa"
            )


@parameters(config=STRICT)
class DisplacementLoop:
    """The controller in front of the valve: proportional, integral, and feedback of the high-passed load pressure.

    The pressure feedback damps the oil's resonance. Where its corner lies below the band, it is all but static, and
    without an integral the actuator gives way under load: compliant on purpose.
    """

    #: Share of full opening per metre of error, in 1/m, and per metre second, in 1/(m*s).
    proportional: Positive
    integral: NotNegative
    #: Share of full opening per pascal of load pressure, in 1/Pa, above the corner, in Hz.
    pressure_feedback: NotNegative
    pressure_corner: Positive


@dataclass(frozen=True)
class DisplacementActuator:
    """An actuator whose input is the wanted stroke in metres.

    States: spool position and scaled velocity, chamber pressures A and B in MPa, low-passed load pressure in MPa, and
    the integral of the error in m*s.
    """

    name: str
    joint_position: int
    joint_velocity: int
    valve: Servovalve
    cylinder: Cylinder
    loop: DisplacementLoop
    supply: Supply

    settles: bool = True

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The wanted stroke, in a drive of the actuator's own name."""
        return (Input(self.name, "m"),)

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Valve shut, both chambers half-way between supply and return."""
        middle = 0.5 * (self.supply.supply_pressure + self.supply.return_pressure) / _PASCAL
        return (0.0, 0.0, middle, middle, 0.0, 0.0)

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Push the piston and return the rates of the hydraulic states."""
        position, speed = motion.joint_positions[self.joint_position], motion.joint_velocities[self.joint_velocity]
        spool, spool_velocity, a, b, low_passed, integral = state
        pressures = (a * _PASCAL, b * _PASCAL)
        load = a - b
        error = values[0] - position
        command = (
            self.loop.proportional * error
            + self.loop.integral * integral
            - self.loop.pressure_feedback * _PASCAL * (load - low_passed)
        )
        # While the valve is at its stop the integral waits: else it would wind up and overshoot afterwards.
        integral_rate = select_positive(1.0 - absolute(command), error, 0.0) if self.loop.integral > 0.0 else 0.0
        flows = port_flows(self.valve, spool, pressures, self.supply.supply_pressure, self.supply.return_pressure)
        rate_a, rate_b = pressure_rates(self.cylinder, position, speed, pressures, flows)
        force = piston_force(self.cylinder, speed, pressures)
        effect.joint_forces[self.joint_velocity] = effect.joint_forces[self.joint_velocity] + force
        effect.monitored[f"{self.name}.stroke"] = position
        effect.monitored[f"{self.name}.valve_command"] = command
        # Share of the most the supply can press with; 1 is a stalled actuator.
        most = self.supply.supply_pressure - self.supply.return_pressure
        effect.monitored[f"{self.name}.load_pressure"] = load * (_PASCAL / most)
        return [
            *spool_rates(self.valve, command, spool, spool_velocity),
            rate_a * (1.0 / _PASCAL),
            rate_b * (1.0 / _PASCAL),
            (load - low_passed) * (2.0 * math.pi * self.loop.pressure_corner),
            integral_rate,
        ]
