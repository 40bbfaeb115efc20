"""How many heaps a process keeps: each thread that begins takes another one, and none gives back what it once held."""

from __future__ import annotations

import ctypes
from typing import Final

# Of mallopt, from malloc.h of the GNU C library.
_M_ARENA_MAX: Final = -8


def keep_few_arenas(count: int) -> bool:
    """Have all threads that begin from now on share so many heaps.

    The GNU C library gives threads up to eight heaps a core. A service that begins a thread for each piece of work,
    tens of megabytes each, holds that much in every heap in the end: hundreds of megabytes that nobody uses.

    Parameters
    ----------
    count : int
        1 or more.

    Returns
    -------
    bool
        Whether the C library took it; others than GNU's have no such thing and need none.

    Raises
    ------
    ValueError
        Fewer than one.
    """
    if count < 1:
        raise ValueError(f"{count} heaps are asked for; a process has 1 or more.")
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and mallopt(_M_ARENA_MAX, count) == 1
