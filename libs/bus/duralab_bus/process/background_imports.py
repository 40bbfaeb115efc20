"""Imports in the background, of modules that a process needs later, and without what it never needs."""

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


_NEVER_NEEDED: Final = ("ctypeslib", "f2py", "testing")
"""Parts of numpy that it imports at their first use."""

_SHARED_BY_SCIPY: Final = "scipy._lib.array_api_compat.numpy"


def import_base_of_scipy() -> None:
    """Import what all packages of scipy share, without parts of numpy that this project does not use.

    scipy copies all names of numpy, which imports these parts: 0.15 s of a processor. numpy still imports each of them
    where it is used.
    """
    if _SHARED_BY_SCIPY in sys.modules:
        return
    import numpy as np

    left_out = [name for name in _NEVER_NEEDED if name not in vars(np)]
    for name in left_out:
        setattr(np, name, None)
    try:
        # If scipy is another one without this module, its packages import what they need, only later.
        with suppress(ImportError):
            import_module(_SHARED_BY_SCIPY)
    finally:
        for name in left_out:
            if vars(np).get(name, np) is None:
                delattr(np, name)


def import_in_background(*imports: str | Callable[[], None]) -> None:
    """Import modules one after the other on a separate thread, so that they are ready when they are needed.

    Parameters
    ----------
    *imports : str or callable
        Names of modules, and functions that are called between their imports. A module that cannot be imported is
        skipped; the code that needs it reports that.
    """

    def work() -> None:
        # Only Linux has a niceness for each thread.
        if sys.platform == "linux":
            own = os.getpriority(os.PRIO_PROCESS, 0)
            os.setpriority(os.PRIO_PROCESS, get_native_id(), own + _NICENESS)
        for wanted in imports:
            if callable(wanted):
                wanted()
                continue
            with suppress(ImportError):
                import_module(wanted)

    Thread(target=work, name="duralab-imports", daemon=True).start()
