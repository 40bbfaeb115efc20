"""Checks of a rig before it plays: equations against Drake, rest, stability, and the length of the step."""

from rig_sim.checks.equilibrium import check_stability, find_equilibrium, linearise
from rig_sim.checks.proof import LateProof, Proof, ProofError, check_lanes, prove
from rig_sim.checks.step_check import check_step, largest_stable_step

__all__ = [
    "LateProof",
    "Proof",
    "ProofError",
    "check_lanes",
    "check_stability",
    "check_step",
    "find_equilibrium",
    "largest_stable_step",
    "linearise",
    "prove",
]
