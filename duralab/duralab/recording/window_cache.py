"""Windows of signals that were read, kept for what is asked next: several channels of one window are read once."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock
from typing import Final

import numpy as np

CACHE_BYTES: Final = 128 * 1024 * 1024
"""So much of the newest windows is kept."""
WINDOW_BYTES: Final = 1024
"""What a window takes beside its samples, rounded up: of single samples that is nearly all."""


@dataclass(frozen=True)
class Window:
    """Drive (drives, samples) and response (responses, samples) of a part of a run, in the rig's units."""

    drive: np.ndarray
    response: np.ndarray

    @property
    def bytes(self) -> int:
        """What it takes in memory, where its arrays are no views of larger ones."""
        return self.drive.nbytes + self.response.nbytes + WINDOW_BYTES


class WindowCache:
    """The windows that were used last; of one recording, by run, first sample and the sample after the last."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, int, int], Window] = OrderedDict()
        self._bytes = 0
        # xarray reads from several threads where its user divides an array into pieces.
        self._lock = Lock()

    def find(self, key: tuple[str, int, int]) -> Window | None:
        """Return a window that is kept; None where it is not."""
        with self._lock:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            return self._kept[key]

    def keep(self, key: tuple[str, int, int], window: Window) -> None:
        """Keep a window, in place of those that were not used for longest; its arrays become read-only.

        Parameters
        ----------
        key : tuple
            Run, first sample, and the sample after the last.
        window : Window
            Its arrays are its own: a view would hold all that it is a view of.
        """
        # Who changes a kept window in place changes what is read later; here it is an error instead.
        window.drive.setflags(write=False)
        window.response.setflags(write=False)
        with self._lock:
            # Two threads may have read the same one.
            replaced = self._kept.pop(key, None)
            self._kept[key] = window
            self._bytes += window.bytes - (replaced.bytes if replaced is not None else 0)
            while self._bytes > CACHE_BYTES and len(self._kept) > 1:
                _, dropped = self._kept.popitem(last=False)
                self._bytes -= dropped.bytes

    def __reduce__(self) -> tuple[type[WindowCache], tuple[()]]:
        """Copy it empty: a dataset that goes to another process takes no windows along, which are read there."""
        return WindowCache, ()
