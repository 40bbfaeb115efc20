"""Imports that a process needs soon, but not yet."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from threading import Thread


def import_in_background(*modules: str) -> None:
    """Import modules one after the other on a thread of its own, so that whoever needs them later finds them.

    Parameters
    ----------
    *modules : str
        Names of modules. One that cannot be imported is left: who needs it says so.
    """

    def work() -> None:
        for module in modules:
            with suppress(ImportError):
                import_module(module)

    Thread(target=work, name="duralab-imports", daemon=True).start()
