"""A four-way servovalve: pilot stage, second-order spool, lands with overlap, square-root orifices, stops."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from pydantic import Field
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import clamp, inverse_sqrt, maximum, select_positive, sqrt
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class Servovalve:
    """Parameters of a valve; those with a default are ideal unless given."""

    #: Flow at full opening and `rated_drop` across one land, in m^3/s.
    rated_flow: Positive
    #: Pressure drop per land at which the flow is rated, in Pa (35 bar by custom).
    rated_drop: Positive
    #: Natural frequency of the spool, in Hz, and its damping ratio.
    spool_frequency: Positive
    spool_damping: Positive
    #: Position of the spool's stops, as a share of full opening: below 1 for a valve that no longer opens fully.
    largest_opening: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    #: Overlap of every land, as a share of full stroke: a dead zone if positive, open edges at null if negative.
    overlap: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    #: Rounding of the edges, as a share of full stroke: the smooth passage from shut to open, and the leak at null.
    rounding: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    #: Flow gain of the lands of port B over those of port A: below 1 for a cylinder whose rod side is smaller.
    port_b_gain: Positive = 1.0
    #: Corner of the first stage (torque motor and pilot), in Hz; 0 for a directly driven spool.
    pilot_frequency: NotNegative = 0.0

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Spool position and scaled velocity, then the pilot stage's command, if there is one: all at null."""
        return (0.0, 0.0, 0.0) if self.pilot_frequency > 0.0 else (0.0, 0.0)


class PortFlows(NamedTuple):
    """Flows in m^3/s: into chamber A, out of chamber B, and the sum drawn from the supply."""

    into_a: Any
    out_of_b: Any
    drawn: Any


def signed_root(ratio: Any) -> Any:
    """Return sign(r) sqrt(|r|), made smooth for |r| below about 0.01.

    The turbulent law has an infinite slope at zero; flow through a real orifice turns laminar there.
    """
    return ratio * inverse_sqrt(sqrt(ratio * ratio + 1.0e-4))


def edge_opening(valve: Servovalve, travel: Any) -> Any:
    """Return the opening of one metering edge, 1 at full stroke."""
    full = 1.0 - valve.overlap
    if valve.rounding == 0.0:
        return maximum(travel - valve.overlap, 0.0) * (1.0 / full)
    square = valve.rounding**2
    beyond = travel - valve.overlap
    return (beyond + sqrt(beyond * beyond + square)) * (1.0 / (full + math.sqrt(full * full + square)))


def port_flows(valve: Servovalve, opening: Any, pressures: tuple[Any, Any], supply: Any, back: Any) -> PortFlows:
    """Return the flows through the valve, in m^3/s.

    ``q = q_rated x sqrt(dp / dp_rated)`` over each metering edge (Merritt, *Hydraulic Control Systems*, chapter 5).
    """
    a, b = pressures
    # The spool meets its stops at full opening: hardware, not a limit of a signal.
    travel = clamp(opening, -valve.largest_opening, valve.largest_opening)
    drop = 1.0 / valve.rated_drop
    if valve.overlap == 0.0 and valve.rounding == 0.0:
        # Two of the four sharp edges are shut at any time.
        gain = valve.rated_flow * travel
        into_a = gain * signed_root(select_positive(opening, supply - a, a - back) * drop)
        out_of_b = valve.port_b_gain * (gain * signed_root(select_positive(opening, b - back, supply - b) * drop))
        return PortFlows(into_a, out_of_b, select_positive(opening, into_a, -out_of_b))
    ahead = valve.rated_flow * edge_opening(valve, travel)
    behind = valve.rated_flow * edge_opening(valve, -travel)
    supply_to_a = ahead * signed_root((supply - a) * drop)
    supply_to_b = valve.port_b_gain * (behind * signed_root((supply - b) * drop))
    into_a = supply_to_a - behind * signed_root((a - back) * drop)
    out_of_b = valve.port_b_gain * (ahead * signed_root((b - back) * drop)) - supply_to_b
    return PortFlows(into_a, out_of_b, supply_to_a + supply_to_b)


def spool_rates(valve: Servovalve, command: Any, state: Any) -> list[Any]:
    """Return the rates of the valve's states, in 1/s."""
    omega = 2.0 * math.pi * valve.spool_frequency
    position, velocity = state[0], state[1]
    wanted = clamp(command, -valve.largest_opening, valve.largest_opening)
    pilot = []
    if valve.pilot_frequency > 0.0:
        pilot = [(wanted - state[2]) * (2.0 * math.pi * valve.pilot_frequency)]
        wanted = state[2]
    return [velocity * omega, (wanted - position - 2.0 * valve.spool_damping * velocity) * omega, *pilot]
