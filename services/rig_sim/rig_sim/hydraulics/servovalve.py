"""A four-way servovalve: second-order spool, square-root orifices, stops at full opening."""

from __future__ import annotations

import math
from typing import Any

from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile.numeric import clamp, select_positive, sqrt
from rig_sim.parameters import STRICT, Positive


@parameters(config=STRICT)
class Servovalve:
    """Parameters of a symmetric, critically lapped valve."""

    #: Flow at full opening and `rated_drop` across one land, in m^3/s.
    rated_flow: Positive
    #: Pressure drop per land at which the flow is rated, in Pa (35 bar by custom).
    rated_drop: Positive
    #: Natural frequency of the spool, in Hz, and its damping ratio.
    spool_frequency: Positive
    spool_damping: Positive


def signed_root(ratio: Any) -> Any:
    """Return sign(r) sqrt(|r|), made smooth where |r| is below about 0.01.

    The turbulent law has an infinite slope at zero; flow through a real orifice turns laminar there.
    """
    return ratio / sqrt(sqrt(ratio * ratio + 1.0e-4))


def port_flows(valve: Servovalve, opening: Any, pressures: tuple[Any, Any], supply: Any, back: Any) -> tuple[Any, Any]:
    """Return the flows into chamber A and out of chamber B.

    Parameters
    ----------
    opening : share of full opening, -1 to 1; positive connects the supply with chamber A
    pressures : pressures of chambers A and B, in Pa
    supply, back : supply and return pressure, in Pa

    Returns
    -------
    tuple
        Flow into A and flow out of B, in m^3/s.

    Notes
    -----
    ``q = q_rated x sqrt(dp / dp_rated)`` over each metering edge (Merritt, *Hydraulic Control Systems*, chapter 5).
    """
    a, b = pressures
    # The spool meets its stops at full opening: hardware, not a limit of a signal.
    gain = valve.rated_flow * clamp(opening, -1.0, 1.0)
    drop = 1.0 / valve.rated_drop
    into_a = gain * signed_root(select_positive(opening, supply - a, a - back) * drop)
    out_of_b = gain * signed_root(select_positive(opening, b - back, supply - b) * drop)
    return into_a, out_of_b


def spool_rates(valve: Servovalve, command: Any, position: Any, velocity: Any) -> tuple[Any, Any]:
    """Return the rates of spool position (share of full opening) and of its scaled velocity, both in 1/s.

    The velocity state is divided by the natural angular frequency, so that both states are of order one.
    """
    omega = 2.0 * math.pi * valve.spool_frequency
    force = clamp(command, -1.0, 1.0) - position - 2.0 * valve.spool_damping * velocity
    return velocity * omega, force * omega
