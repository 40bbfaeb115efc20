"""How a playback used its actuators."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Use:
    """How one drive channel used its actuator.

    A drive that moves no actuator (a road) has a peak and nothing else.

    Parameters
    ----------
    drive : str
        The drive's name.
    peak_command_ratio : float
        Largest magnitude of the drive over the limit in that direction, 0 to 1.
    saturated_share : float
        Share of the time in which the valve was at its stop or the load pressure at its limit, 0 to 1.
    largest_following_error : float
        Largest difference of command and achieved value, in the drive's unit.
    largest_load_pressure_share : float
        Largest load pressure over what the supply could press with at that moment, 0 to 1; 1 is a stall.
    lowest_supply_pressure : float
        Of the actuator's supply, in Pa.
    """

    drive: str
    peak_command_ratio: float
    saturated_share: float
    largest_following_error: float
    largest_load_pressure_share: float = 0.0
    lowest_supply_pressure: float = 0.0
