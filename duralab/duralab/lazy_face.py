"""Lazy imports for a package's `__init__`: a module is imported at the first use of one of its names."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path


def lazy_face(package: str) -> Callable[[str], object]:
    """Return the `__getattr__` of a package; it imports a name from the module given under `if TYPE_CHECKING`."""

    @cache
    def module_of() -> dict[str, str]:
        source = Path(sys.modules[package].__file__ or "").read_text(encoding="utf-8")
        typed = (node for block in ast.parse(source).body if isinstance(block, ast.If) for node in block.body)
        imports = [node for node in typed if isinstance(node, ast.ImportFrom)]
        return {alias.name: str(node.module) for node in imports for alias in node.names}

    def attribute(name: str) -> object:
        if name.startswith("__") or name not in module_of():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(module_of()[name]), name)

    return attribute
