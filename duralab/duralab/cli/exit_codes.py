"""Exit codes of every command; docs/reference/exit_codes.md is this table, and a test holds the two together."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class ExitCode(IntEnum):
    """How a command ended, as a shell sees it."""

    DONE = 0
    FAILED = 1
    USER_ERROR = 2
    NOT_REACHED = 3
    INTERRUPTED = 130
    TERMINATED = 143


MEANINGS: Final = {
    ExitCode.DONE: "done",
    ExitCode.FAILED: "the lab, a campaign or a check failed",
    ExitCode.USER_ERROR: "a wrong value or option",
    ExitCode.NOT_REACHED: "finished, but the target was not reached",
    ExitCode.INTERRUPTED: "interrupted",
    ExitCode.TERMINATED: "terminated",
}
"""What each means, in words."""
