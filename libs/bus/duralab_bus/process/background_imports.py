"""Imports that a process needs soon, but not yet."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from threading import Thread


def import_in_background(*modules: str) -> None:
    """Import modules one after the other on a separate thread, so that they are ready when they are needed.

    Parameters
    ----------
    *modules : str
        Names of modules. One that cannot be imported is skipped; the code that needs it reports that.
    """

    def work() -> None:
        for module in modules:
            with suppress(ImportError):
                import_module(module)

    Thread(target=work, name="duralab-imports", daemon=True).start()
