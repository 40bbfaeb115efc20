"""Result of a recorded campaign."""

from __future__ import annotations

from enum import StrEnum


class Result(StrEnum):
    """Result of a recorded campaign."""

    REACHED = "reached"
    ITERATIONS_USED = "iterations used"
    DIVERGED = "diverged"
    NO_IMPROVEMENT = "no improvement"
    DAMAGE_BUDGET_USED = "damage budget used"
    RESPONSE_STOOD_STILL = "response stood still"
    BOUND_PASSED = "bound passed"
    ENDED_AT_HOLD_POINT = "ended at hold point"
    FINISHED = "finished"
    FAULTED = "faulted"
    STOPPED = "stopped"
    NOT_ENDED = "not ended"
    PRE_TEST_PASSED = "pre-test passed"
    PRE_TEST_FAILED = "pre-test not passed"
    PRE_TEST_UNFINISHED = "pre-test unfinished"
