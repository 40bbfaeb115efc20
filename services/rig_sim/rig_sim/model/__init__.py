"""The equations of a rig: the specimen's parts and sensors on the tree of the SDF, as one function to trace."""

from rig_sim.model.measurement import Sensor

__all__ = [
    "Sensor",
]
