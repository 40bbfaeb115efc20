"""Servo-hydraulic actuators: servovalve, cylinder, supply and the control loop in front of them."""

from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.hydraulics.supply import Accumulator, PowerUnit

__all__ = [
    "Accumulator",
    "PowerUnit",
    "Servovalve",
]
