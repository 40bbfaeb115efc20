"""Equations of a rig: the specimen's parts and sensors on the tree of the SDF, as one function to trace."""

from rig_sim.model.assembly import Assembly, assemble
from rig_sim.model.measurement import BushingForce, Sensor, SpindleForce, StrutTravel
from rig_sim.model.rig_model import Evaluation, RigModel
from rig_sim.model.wearing import WearingPart

__all__ = [
    "Assembly",
    "BushingForce",
    "Evaluation",
    "RigModel",
    "Sensor",
    "SpindleForce",
    "StrutTravel",
    "WearingPart",
    "assemble",
]
