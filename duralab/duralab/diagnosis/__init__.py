"""What would keep a lab from working on this machine, and what to do about it."""

from duralab.diagnosis.examining import examine
from duralab.diagnosis.finding import Finding, Severity

__all__ = ["Finding", "Severity", "examine"]
