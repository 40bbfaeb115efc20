"""The hydraulic supply: a constant pressure, or a pump with an accumulator whose pressure sags when oil is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import clamp, exp, maximum, select_positive
from rig_sim.multibody import Array, Effect, Input, Line, Motion
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class Accumulator:
    """A bladder of nitrogen against the oil."""

    #: Gas at the precharge, in m^3, and that pressure, in Pa.
    gas_volume: Positive
    precharge: Positive
    #: 1 for gas at constant temperature, 1.4 without heat transfer; a stroke of seconds is near 1.25.
    polytropic_exponent: Annotated[float, Field(ge=1.0, le=1.7)]


@parameters(config=STRICT)
class PowerUnit:
    """A pressure-compensated pump, its relief valve, the accumulator and the line to the actuators."""

    #: Largest flow of the pump, in m^3/s.
    pump_flow: Positive
    #: Pressure below `supply_pressure`, in Pa, at which the pump gives all its flow; at `supply_pressure` it gives 0.
    compensator_band: Positive
    #: Time constant of the pump's swash plate, in s.
    pump_time: Positive
    #: Drain of pump and manifold to the tank, in m^3/(s Pa).
    drain: Positive
    #: Pressure above which the relief valve opens, in Pa, and its slope, in m^3/(s Pa).
    relief_pressure: Positive
    relief_slope: Positive
    accumulator: Accumulator
    #: Oil in the line, in m^3, and its bulk modulus, in Pa.
    line_volume: Positive
    bulk_modulus: Positive


@parameters(config=STRICT)
class Supply:
    """Pressures of the hydraulic power unit, in Pa; constant, unless a `unit` makes the supply's pressure."""

    supply_pressure: Positive
    return_pressure: NotNegative
    unit: PowerUnit | None = None

    def __post_init__(self) -> None:
        if not self.supply_pressure > self.return_pressure:
            raise ValueError(
                f"supply_pressure is {self.supply_pressure:g} Pa; it must be above return_pressure, "
                f"{self.return_pressure:g} Pa"
            )
        if self.unit is None:
            return
        if not self.return_pressure < self.unit.accumulator.precharge < self.supply_pressure:
            raise ValueError(
                f"precharge is {self.unit.accumulator.precharge:g} Pa; it must be between return_pressure, "
                f"{self.return_pressure:g} Pa, and supply_pressure, {self.supply_pressure:g} Pa"
            )
        if not self.unit.relief_pressure > self.supply_pressure:
            raise ValueError(
                f"relief_pressure is {self.unit.relief_pressure:g} Pa; it must be above supply_pressure, "
                f"{self.supply_pressure:g} Pa"
            )


def oil_capacity(unit: PowerUnit, pressure: Any, gas_volume: Any) -> Any:
    """Return the capacity of the supply: additional oil per pressure, in m^3/Pa."""
    gas = unit.accumulator
    line = unit.line_volume / unit.bulk_modulus
    return select_positive(pressure - gas.precharge, gas_volume / (gas.polytropic_exponent * pressure), 0.0) + line


@dataclass(frozen=True)
class HydraulicSupply:
    """A supply as an element: offers its pressure to the actuators, then gets their total flow.

    States, if it has a power unit: the natural logarithm of the pressure over the precharge (the polytropic law is
    then an exponential), and the pump's flow as a share of its largest.
    """

    name: str
    law: Supply

    settles: bool = True
    inputs: tuple[Input, ...] = ()

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Return the state just below the pressure at which the pump gives no flow."""
        unit = self.law.unit
        if unit is None:
            return ()
        start = self.law.supply_pressure - 0.05 * unit.compensator_band
        return (math.log(start / unit.accumulator.precharge), 0.05)

    def offer(self, state: Array, effect: Effect) -> None:
        """Add the line to `effect`, before any actuator uses it."""
        unit = self.law.unit
        pressure = self.law.supply_pressure if unit is None else unit.accumulator.precharge * exp(state[0])
        effect.lines[self.name] = Line(pressure, self.law.return_pressure)

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Return the rates of pressure and pump, given the flow to all actuators."""
        del motion, values
        line, unit = effect.lines[self.name], self.law.unit
        effect.monitored[f"{self.name}.pressure"] = line.pressure
        effect.monitored[f"{self.name}.flow"] = line.drawn
        if unit is None:
            return []
        gas_volume = unit.accumulator.gas_volume * exp(state[0] * (-1.0 / unit.accumulator.polytropic_exponent))
        wanted = clamp((self.law.supply_pressure - line.pressure) * (1.0 / unit.compensator_band), 0.0, 1.0)
        relieved = unit.relief_slope * maximum(line.pressure - unit.relief_pressure, 0.0)
        net = (
            unit.pump_flow * state[1] - unit.drain * (line.pressure - self.law.return_pressure) - relieved - line.drawn
        )
        return [
            net / (oil_capacity(unit, line.pressure, gas_volume) * line.pressure),
            (wanted - state[1]) * (1.0 / unit.pump_time),
        ]
