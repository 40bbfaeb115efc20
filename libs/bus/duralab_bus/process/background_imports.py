"""Imports in the background, of modules that a process needs later."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from threading import Thread, get_native_id
from typing import Final

_NICENESS: Final = 5
"""Niceness of the importing thread above its process: a rig that is being loaded comes first."""


def import_in_background(*modules: str, then: Callable[[], None] | None = None) -> None:
    """Import modules one after the other on a separate thread, so that they are ready when they are needed.

    Parameters
    ----------
    *modules : str
        Names of modules. One that cannot be imported is skipped; the code that needs it reports that.
    then : callable, optional
        Called on the same thread after the imports.
    """

    def work() -> None:
        # Only Linux has a niceness for each thread.
        if sys.platform == "linux":
            own = os.getpriority(os.PRIO_PROCESS, 0)
            os.setpriority(os.PRIO_PROCESS, get_native_id(), own + _NICENESS)
        for module in modules:
            with suppress(ImportError):
                import_module(module)
        if then is not None:
            then()

    Thread(target=work, name="duralab-imports", daemon=True).start()
