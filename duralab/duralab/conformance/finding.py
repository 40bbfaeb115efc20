"""What a check found: passed, failed with a sentence, or not tried with a sentence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """How a check ended."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Finding:
    """One line of a conformance check.

    `check`: What was tried, in words. `outcome`: How it ended. `sentence`: Why it failed or was not tried; empty where
    it passed.
    """

    check: str
    outcome: Outcome
    sentence: str = ""


class BreachError(Exception):
    """The rig breaks the contract; the message is the sentence."""


class NotTriedError(Exception):
    """The check does not apply, or would not be safe; the message is the sentence."""


def expect(condition: bool, sentence: str) -> None:
    """Raise a breach where a condition does not hold."""
    if not condition:
        raise BreachError(sentence)


def all_passed(findings: Iterable[Finding]) -> bool:
    """Return whether nothing failed; what was not tried is no failure.

    `findings`: Of any checks.
    Returns: True also where nothing was checked.
    """
    return all(finding.outcome is not Outcome.FAILED for finding in findings)
