"""Check of the Python version, before the import of modules that an older Python cannot parse."""

from __future__ import annotations

OLDEST = (3, 11)
"""Oldest supported version."""


def python_fault(version: tuple[int, ...]) -> str | None:
    """Return a sentence about a Python that is too old; None if it is supported."""
    if version >= OLDEST:
        return None
    found, oldest = ".".join(str(part) for part in version), ".".join(str(part) for part in OLDEST)
    return f"This is Python {found}; duralab needs {oldest} or later."
