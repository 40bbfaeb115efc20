"""Servo-hydraulic actuators on prismatic joints, in displacement or in force control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rig_sim.compile import select_positive
from rig_sim.hydraulics.cylinder import Cylinder, load_pressure, piston_force, pressure_rates
from rig_sim.hydraulics.loops import DisplacementLoop, Feedback, ForceLoop, Loop, Piston, control, initial_loop_state
from rig_sim.hydraulics.servovalve import Servovalve, port_flows, spool_rates
from rig_sim.multibody import Array, Effect, Input, Motion, SpringDamper, dot, stretch

#: Pascals per megapascal, the unit of pressure states: of order one like all others, for any integrator.
_PASCAL = 1.0e6


@dataclass(frozen=True)
class LoadCell:
    """Measures the force in the rod between piston and specimen, along the stroke."""

    rod: SpringDamper
    #: The piston's body, and the joint that guides it, by their indices.
    piston: int
    joint: int
    #: Mass of the piston in kg and gravity (3,) in m/s^2, for the balance of an accelerometer beside the cell.
    piston_mass: float
    gravity: np.ndarray

    def read(self, motion: Motion) -> Any:
        """Return the force of the piston on the specimen in N, positive along a positive stroke."""
        rod = self.rod
        _, _, direction, length, rate = stretch(motion, rod.body_a, rod.point_a, rod.body_b, rod.point_b)
        pull = (length - rod.free_length) * rod.stiffness + rate * rod.damping
        along = dot(direction, motion.axes[self.joint][0].linear)
        # A pulling rod draws body A along its direction and body B against it.
        return -(pull * along) if rod.body_a == self.piston else pull * along

    def acceleration(self, motion: Motion, pressed: Any) -> Any:
        """Return the acceleration of the piston in m/s^2 if only oil, seals, rod and gravity move it."""
        fall = dot(self.gravity, motion.axes[self.joint][0].linear)
        return (pressed - self.read(motion)) * (1.0 / self.piston_mass) + fall


@dataclass(frozen=True, kw_only=True)
class HydraulicActuator:
    """Valve, cylinder and loop of one actuator; its loop decides whether the drive is a stroke in m or a force in N.

    A force is that on the specimen, positive along a positive stroke. States: spool position and scaled velocity, the
    pilot stage's command (if the valve has one), chamber pressures A and B in MPa, low-passed load pressure in MPa, the
    integral of the error, and the filtered command with its scaled rate (if the loop feeds it forward).
    """

    #: Unique name in the rig, also of the drive.
    name: str
    #: Index of the piston's joint among the positions and among the velocities.
    joint_position: int
    joint_velocity: int
    valve: Servovalve
    cylinder: Cylinder
    loop: Loop
    #: Name of the supply that feeds it.
    supply: str
    #: Half-way pressure in Pa, from which the search for rest begins.
    middle_pressure: float
    #: Load cell, if it is the feedback of a force loop.
    load_cell: LoadCell | None = None

    settles: bool = True

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Desired stroke or force, in a drive with the actuator's name."""
        return (Input(self.name, "N" if isinstance(self.loop, ForceLoop) else "m"),)

    @property
    def achieved(self) -> str:
        """Name of the monitored value that follows the drive: the stroke, or the force in the loop's feedback."""
        return f"{self.name}.{'force' if isinstance(self.loop, ForceLoop) else 'stroke'}"

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Valve shut, chambers half-way between supply and return, side B higher where it is the smaller one."""
        middle = self.middle_pressure / _PASCAL
        return (*self.valve.initial_state, middle * self.cylinder.area_ratio, middle, *initial_loop_state(self.loop))

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Push the piston, draw from the supply and return the rates of the hydraulic states."""
        position, speed = motion.joint_positions[self.joint_position], motion.joint_velocities[self.joint_velocity]
        line = effect.lines[self.supply]
        chambers = len(self.valve.initial_state)
        spool, (a, b) = state[:chambers], state[chambers : chambers + 2]
        pressures = (a * _PASCAL, b * _PASCAL)
        load = load_pressure(self.cylinder, a, b)
        force = piston_force(self.cylinder, position, speed, pressures)
        achieved = self._measure(motion, load)
        command, loop_rates = control(
            self.loop,
            state[chambers + 2 :],
            wanted=values[0],
            achieved=achieved,
            piston=Piston(load, speed, self._accelerometer(motion, force)),
        )
        flows = port_flows(self.valve, spool[0], pressures, line.pressure, line.back)
        line.drawn = line.drawn + flows.drawn
        rate_a, rate_b = pressure_rates(self.cylinder, position, speed, pressures, (flows.into_a, flows.out_of_b))
        effect.joint_forces[self.joint_velocity] = effect.joint_forces[self.joint_velocity] + force
        effect.monitored[f"{self.name}.stroke"] = position
        effect.monitored[f"{self.name}.valve_command"] = command
        effect.monitored[f"{self.name}.load_pressure"] = load * _PASCAL / self._stall_pressure(load, line)
        effect.monitored[self.achieved] = achieved
        return [
            *spool_rates(self.valve, command, spool),
            rate_a * (1.0 / _PASCAL),
            rate_b * (1.0 / _PASCAL),
            *loop_rates,
        ]

    def _measure(self, motion: Motion, load: Any) -> Any:
        """Return the controlled value of the loop, given the motion and the load pressure in MPa."""
        if isinstance(self.loop, DisplacementLoop):
            return motion.joint_positions[self.joint_position]
        if self.loop.feedback is Feedback.PRESSURE:
            return load * (_PASCAL * self.cylinder.area)
        if self.load_cell is None:
            raise ValueError(f"actuator {self.name!r} has no load cell, and its loop wants one.")
        return self.load_cell.read(motion)

    def _accelerometer(self, motion: Motion, pressed: Any) -> Any:
        """Return the piston's acceleration in m/s^2, given the force of oil and seals on it; zero without a sensor."""
        compensated = isinstance(self.loop, ForceLoop) and self.loop.acceleration_compensation != 0.0
        return self.load_cell.acceleration(motion, pressed) if self.load_cell and compensated else 0.0

    def _stall_pressure(self, load: Any, line: Any) -> Any:
        """Return the load pressure in Pa that the supply can reach in this direction: a share of 1 is a stall."""
        ratio = self.cylinder.area_ratio
        if ratio == 1.0:
            return line.pressure - line.back
        return select_positive(load, line.pressure - line.back * ratio, line.pressure * ratio - line.back)
