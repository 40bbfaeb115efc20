"""Which machine the figures are of, and how much of it was there."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from types import TracebackType


def machine() -> dict[str, str | int | float]:
    """Return processor, how many of them, kernel, Python, and the load before it began."""
    return {
        "processor": _processor(),
        "processors": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 2),
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


class ProcessorTime:
    """How much of the processors' time the host of a virtual machine gave to others while this was entered."""

    def __init__(self) -> None:
        self.stolen_share = 0.0
        """Of the time in which they had something to do; 0 if the system does not report it."""

    def __enter__(self) -> ProcessorTime:
        """Begin."""
        self._busy, self._stolen = _processor_ticks()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""
        busy, stolen = _processor_ticks()
        self.stolen_share = (stolen - self._stolen) / max(busy - self._busy, 1)


def _processor_ticks() -> tuple[int, int]:
    """Return how long all processors had something to do, and how much of it the host took."""
    statistics = Path("/proc/stat")
    if not statistics.exists():
        return 0, 0
    user, nice, system, _idle, _waiting, interrupts, soft_interrupts, stolen = map(
        int, statistics.read_text().split(maxsplit=9)[1:9]
    )
    return user + nice + system + interrupts + soft_interrupts + stolen, stolen
