"""What would keep a lab from working on this machine, and what to do about it."""

from duralab.diagnosis.checks import Finding, Severity, examine

__all__ = ["Finding", "Severity", "examine"]
