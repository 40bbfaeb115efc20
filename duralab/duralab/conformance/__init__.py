"""Does a rig keep the contract of docs/contract.md: a simulated one, or a real one behind its gateway."""

from duralab.conformance.bench import Finding, Outcome, all_passed
from duralab.conformance.checking import check_rig

__all__ = ["Finding", "Outcome", "all_passed", "check_rig"]
