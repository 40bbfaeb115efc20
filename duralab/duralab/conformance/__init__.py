"""Does a rig keep the contract of docs/contract.md: a simulated one, or a real one behind its gateway."""

from duralab.conformance.checking import check_rig
from duralab.conformance.finding import Finding, Outcome, all_passed

__all__ = ["Finding", "Outcome", "all_passed", "check_rig"]
