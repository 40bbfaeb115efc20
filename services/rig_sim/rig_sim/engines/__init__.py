"""Choice of the program that integrates a rig, Drake as one of them, and Drake's measurements."""

from rig_sim.engines.choice import Engine, EngineChoice
from rig_sim.engines.drake_engine import AppliedForces, DrakeEngine, Player, applied_force, drake_responses

__all__ = [
    "AppliedForces",
    "DrakeEngine",
    "Engine",
    "EngineChoice",
    "Player",
    "applied_force",
    "drake_responses",
]
