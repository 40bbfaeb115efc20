"""Servo-hydraulic actuators: servovalve, cylinder, supply and the control loop in front of them."""

from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.hydraulics.mounting import CONTROLS, ActuatorKind, ActuatorPart, all_supplies, check_limits, mount_actuator
from rig_sim.hydraulics.servovalve import Servovalve, port_flows
from rig_sim.hydraulics.supply import Accumulator, HydraulicSupply, PowerUnit, Supply

__all__ = [
    "CONTROLS",
    "Accumulator",
    "ActuatorKind",
    "ActuatorPart",
    "HydraulicActuator",
    "HydraulicSupply",
    "PowerUnit",
    "Servovalve",
    "Supply",
    "all_supplies",
    "check_limits",
    "mount_actuator",
    "port_flows",
]
