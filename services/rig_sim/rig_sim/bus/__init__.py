"""A simulated rig in the contract's words: what the gateway serves, its shapes and lines for a view."""

from rig_sim.bus.simulated_rig import SimulatedRig, describe_rig, simulated
from rig_sim.bus.view_messages import describe_view

__all__ = [
    "SimulatedRig",
    "describe_rig",
    "describe_view",
    "simulated",
]
