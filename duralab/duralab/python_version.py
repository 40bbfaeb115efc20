"""Check of the Python version, before anything is imported that another one could not read."""

from __future__ import annotations

OLDEST = (3, 11)
"""First version that has everything the lab needs."""


def python_fault(version: tuple[int, ...]) -> str | None:
    """Return what is wrong with a Python in one sentence; None where nothing is."""
    if version >= OLDEST:
        return None
    found, oldest = ".".join(str(part) for part in version), ".".join(str(part) for part in OLDEST)
    return f"This is Python {found}; duralab needs {oldest} or later."
