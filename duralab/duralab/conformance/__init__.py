"""Check whether a rig, simulated or real behind its gateway, conforms to the contract of docs/contract.md."""

from duralab.conformance.bench import Finding, Outcome, all_passed
from duralab.conformance.checking import check_rig

__all__ = ["Finding", "Outcome", "all_passed", "check_rig"]
