"""The choice of the program that integrates a rig; Drake as one of them, and what Drake measures."""

from rig_sim.engines.choice import Engine, EngineChoice, Player
from rig_sim.engines.drake_engine import DrakeEngine, drake_responses

__all__ = [
    "DrakeEngine",
    "Engine",
    "EngineChoice",
    "Player",
    "drake_responses",
]
