"""Control loops in front of the valve: displacement and force, each PI(D) with load-pressure feedback and feed-forward.

The parameters of a controller convert metres, newtons and pascals to a share of the valve's full opening.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, NamedTuple

from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import absolute, select_positive
from rig_sim.multibody import Array
from rig_sim.parameters import STRICT, NotNegative, Positive

#: Damping ratio of the filter that differentiates a command: the flattest pass band.
_FILTER_DAMPING = math.sqrt(0.5)


class Command(NamedTuple):
    """A drive and its derivatives: m or N, per second, per second squared."""

    value: Any
    rate: Any = 0.0
    acceleration: Any = 0.0


class Piston(NamedTuple):
    """State of the piston as the controller measures it: load pressure in MPa, speed in m/s, acceleration in m/s^2."""

    load_pressure: Any
    speed: Any
    #: Acceleration, if the piston has an accelerometer.
    acceleration: Any = 0.0


class Feedback(StrEnum):
    """Source of the feedback of a force loop."""

    #: A load cell in the rod between piston and specimen.
    LOAD_CELL = "load_cell"
    #: Both chambers' pressures times their areas: friction and the piston's inertia included.
    PRESSURE = "pressure"


@parameters(config=STRICT)
class _Controller:
    """Common part of both controllers of the valve."""

    #: Share of full opening per metre or newton of error, in 1/m or 1/N, and per metre or newton second.
    proportional: Positive
    integral: NotNegative
    #: Share of full opening per pascal of load pressure, in 1/Pa, above the corner, in Hz.
    pressure_feedback: NotNegative
    pressure_corner: Positive
    #: Corner of the second-order filter that differentiates the command, in Hz.
    command_filter: Positive = 200.0


@parameters(config=STRICT)
class DisplacementLoop(_Controller):
    """The controller in front of the valve: PID, feed-forward, and feedback of the high-passed load pressure.

    The pressure feedback damps the oil's resonance. If its corner is below the band, it is almost static, and without
    an integral the actuator yields under load: compliant on purpose.
    """

    #: Reduction of the opening per m/s of the piston, as a share of full opening, in s/m; equal to
    #: `velocity_feedforward` it acts on the rate of the error.
    derivative: NotNegative = 0.0
    #: Share of full opening per m/s and per m/s^2 of the command, in s/m and s^2/m.
    velocity_feedforward: NotNegative = 0.0
    acceleration_feedforward: NotNegative = 0.0

    @property
    def filters_command(self) -> bool:
        """Whether the command's derivatives are needed, which takes two states."""
        return self.velocity_feedforward > 0.0 or self.acceleration_feedforward > 0.0

    def feed(self, command: Command, piston: Piston) -> Any:
        """Return the feed-forward addition to P, I and pressure feedback, as a share of full opening."""
        return (
            self.velocity_feedforward * command.rate
            + self.acceleration_feedforward * command.acceleration
            - self.derivative * piston.speed
        )

    #: Whether the specimen's motion is compensated: the stroke is what this loop controls.
    compensates_motion = False
    #: Unit of the integral's state, in m*s.
    integral_unit = 1.0


@parameters(config=STRICT)
class ForceLoop(_Controller):
    """A force controller: PI, load-pressure feedback, feed-forward, compensation of the specimen's motion.

    An actuator in force control is an integrator (oil is stiff, the valve gives flow); the part of the pressure
    feedback above its corner is the loop's derivative action. `velocity_compensation` gives the piston the oil that the
    moving specimen takes: without it, a specimen near its resonance runs away from the actuator and the force drops
    (Dimig, Shield, French, Bailey and Clark, "Effective force testing", J. Struct. Eng. 125, 1999).
    """

    feedback: Feedback = Feedback.LOAD_CELL
    #: Share of full opening per newton and per N/s of the command, in 1/N and s/N.
    feedforward: NotNegative = 0.0
    rate_feedforward: NotNegative = 0.0
    #: Share of full opening per m/s of the piston, in s/m, and per m/s^2 of its accelerometer, in s^2/m: the lead that
    #: compensates the valve's lag. If velocity compensation is area over flow gain, all of the oil is given.
    velocity_compensation: NotNegative = 0.0
    acceleration_compensation: NotNegative = 0.0
    #: Corner of the first-order filter behind the sensors of speed and acceleration, in Hz, against their noise.
    motion_filter: Positive = 500.0

    def __post_init__(self) -> None:
        if self.acceleration_compensation > 0.0 and self.feedback is not Feedback.LOAD_CELL:
            raise ValueError(
                f"acceleration_compensation is {self.acceleration_compensation:g} s^2/m; with feedback: "
                f"{self.feedback} it must be 0, for it takes the load cell"
            )

    @property
    def filters_command(self) -> bool:
        """Whether the command's derivative is needed, which takes two states."""
        return self.rate_feedforward > 0.0

    @property
    def compensates_motion(self) -> bool:
        """Whether the specimen's motion is compensated; this adds a state."""
        return self.velocity_compensation > 0.0 or self.acceleration_compensation > 0.0

    def feed(self, command: Command, piston: Piston) -> Any:
        """Return the feed-forward addition to P, I, pressure feedback and compensation, as a share of full opening."""
        del piston
        return self.feedforward * command.value + self.rate_feedforward * command.rate

    def compensate(self, piston: Piston) -> Any:
        """Return the opening that gives the oil needed by the piston's motion, before its filter."""
        return self.velocity_compensation * piston.speed + self.acceleration_compensation * piston.acceleration

    #: Unit of the integral's state, in N*s: of order one like the other states.
    integral_unit = 1.0e3


Loop = DisplacementLoop | ForceLoop


def initial_loop_state(loop: Loop) -> tuple[float, ...]:
    """Return low-passed load pressure in MPa, integral of the error, and the states of the loop's filters.

    These are value and scaled rate of the command's filter, and the opening that compensates the specimen's motion.
    """
    return (0.0,) * (2 + 2 * loop.filters_command + loop.compensates_motion)


def control(loop: Loop, state: Array, *, wanted: Any, achieved: Any, piston: Piston) -> tuple[Any, list[Any]]:
    """Return the valve's command and the rates of the loop's states."""
    low_passed, integral = state[0], state[1]
    error = wanted - achieved
    opening = (
        loop.proportional * error
        + (loop.integral * loop.integral_unit) * integral
        - (loop.pressure_feedback * 1.0e6) * (piston.load_pressure - low_passed)
    )
    command, filter_rates = Command(wanted), []
    if loop.filters_command:
        omega = 2.0 * math.pi * loop.command_filter
        scaled = wanted - state[2] - 2.0 * _FILTER_DAMPING * state[3]
        command = Command(wanted, omega * state[3], omega * omega * scaled)
        filter_rates = [command.rate, omega * scaled]
    opening = opening + loop.feed(command, piston)
    motion_rates = []
    if isinstance(loop, ForceLoop) and loop.compensates_motion:
        given = state[2 + len(filter_rates)]
        opening = opening + given
        motion_rates = [(loop.compensate(piston) - given) * (2.0 * math.pi * loop.motion_filter)]
    # While the valve is at its stop the integral is frozen: else it would wind up and overshoot afterwards.
    integral_rate = select_positive(1.0 - absolute(opening), error, 0.0) if loop.integral > 0.0 else 0.0
    return opening, [
        (piston.load_pressure - low_passed) * (2.0 * math.pi * loop.pressure_corner),
        integral_rate * (1.0 / loop.integral_unit),
        *filter_rates,
        *motion_rates,
    ]
