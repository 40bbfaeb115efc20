"""Metrics of a rig for Prometheus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from duralab_bus import Metrics
from duralab_proto.v1 import rig_pb2

#: Label of a rig's metrics.
_RIG: Final = ("rig",)


class RigMetrics:
    """Metrics of a rig: is it latched, does it play, how fast, and how often its playbacks ended.

    `metrics`: Of the process. `rig`: Its name. `state`: Returns its state now.
    """

    def __init__(self, metrics: Metrics, rig: str, state: Callable[[], rig_pb2.RigState]) -> None:
        self._rig = rig
        self._factor: dict[tuple[str, ...], float] = {}
        self._playbacks = metrics.count(
            "duralab_rig_playbacks_total", "Playbacks that ended, by rig and code", labels=("rig", "code")
        )
        self._seconds = metrics.count(
            "duralab_rig_played_seconds_total", "Length of the drives played to their end", labels=_RIG
        )
        readings: tuple[tuple[str, str, Callable[[rig_pb2.RigState], float]], ...] = (
            ("interlocked", "1 while the rig is latched", lambda now: now.mode == rig_pb2.RIG_MODE_INTERLOCKED),
            ("playing", "1 while a run moves the rig", lambda now: now.run != ""),
            ("run_fraction", "Share of the run that is played", lambda now: now.fraction),
        )
        for name, what, read in readings:
            metrics.follow(f"duralab_rig_{name}", what, lambda read=read: {(rig,): float(read(state()))}, labels=_RIG)
        metrics.follow(
            "duralab_rig_real_time_factor", "Seconds of drive a second, of the last playback", self._read, labels=_RIG
        )

    def played(self, result: rig_pb2.PlayResult, *, seconds: float) -> None:
        """Count a playback that came to its end."""
        self._playbacks.add(self._rig, "OK")
        self._seconds.add(self._rig, amount=seconds)
        self._factor = {(self._rig,): result.real_time_factor}

    def broken_off(self, code: str) -> None:
        """Count one that did not, with the fault's code."""
        self._playbacks.add(self._rig, code)

    def _read(self) -> Mapping[tuple[str, ...], float]:
        return self._factor
