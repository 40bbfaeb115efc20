"""Diagnosis of this machine: problems that keep a lab from working, each with its remedy."""

from duralab.diagnosis.checks import Finding, Severity, examine

__all__ = ["Finding", "Severity", "examine"]
