"""The SDK's reference: every public name of `duralab` and of its public subpackages, from the docstrings."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

PACKAGES = ("duralab", "duralab.formats", "duralab.target")
"""Packages that scripts import."""


def python_page() -> str:
    """Return the page, with a directive for each name that mkdocstrings replaces by its documentation."""
    parts = ["# Python\n", "What `import duralab` gives, and the packages beside it; made from the docstrings.\n"]
    for name in PACKAGES:
        module = import_module(name)
        parts += [f"## {name}\n", f"{(module.__doc__ or '').strip()}\n"]
        parts += [f"::: {name}.{public}\n" for public in _public_names(module)]
    return "\n".join(parts)


def _public_names(module: ModuleType) -> list[str]:
    if hasattr(module, "__all__"):
        return list(module.__all__)
    return [
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", None) == module.__name__
    ]
