"""Whole rigs in Functional Mock-up Units (FMI 2.0 and 3.0 co-simulation), each run in its own process."""

from rig_sim.fmu.rig import FmuRig, load_fmu_rig
from rig_sim.fmu.specimen import KIND

__all__ = ["KIND", "FmuRig", "load_fmu_rig"]
