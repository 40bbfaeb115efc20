"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """What a finding means for a lab."""

    FINE = "fine"
    WARNING = "warning"
    """A lab works, a part of it does not, or not for long."""
    PROBLEM = "problem"
    """No lab works before this is mended."""


@dataclass(frozen=True)
class Finding:
    """What was found.

    `check`: What was looked at. `severity`: What it means. `sentence`: What was found. `remedy`: What to do; empty
    where nothing is to be done.
    """

    check: str
    severity: Severity
    sentence: str
    remedy: str = ""


def fine(check: str, sentence: str) -> Finding:
    """Return that all is well."""
    return Finding(check, Severity.FINE, sentence)


def warning(check: str, sentence: str, remedy: str) -> Finding:
    """Return what does not work, or not for long, and what to do."""
    return Finding(check, Severity.WARNING, sentence, remedy)


def problem(check: str, sentence: str, remedy: str) -> Finding:
    """Return what keeps a lab from working, and what to do."""
    return Finding(check, Severity.PROBLEM, sentence, remedy)
